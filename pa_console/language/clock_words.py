"""Parsers for times of day, days and durations: *half past nine*, *tonight*, *1 h 15 min*.

In *send a drone north at 16:45*, the time belongs to the order; in *the storm will hit in an hour*,
it belongs to something else. A time that belongs to the order must not be ignored, even if it was
not understood.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date, datetime, time, timedelta

from pa_console.language.lexicon import find_verbs, word_lists
from pa_console.language.mentions import ASSETS
from pa_console.language.name_linking import KIND_WORDS, link_names
from pa_console.language.references.reader import (
    EVERYBODY,
    Reader,
    WordToken,
    number_of,
    read_tokens,
)
from pa_console.schema.mission import DAY_S
from pa_console.schema.world import World

TIME_WORDS = word_lists("times")
_UNIT_S = {
    word: seconds
    for name, seconds in (("seconds", 1.0), ("minutes", 60.0), ("hours", 3600.0), ("days", DAY_S))
    for word in TIME_WORDS[name]
}
TIME_UNITS = tuple(_UNIT_S)
"""The words for units of time, abbreviations included: *mins*, *hrs*."""
WEEKDAYS = TIME_WORDS["weekdays"]
_TENS = {word: 20 + 10 * number for number, word in enumerate(TIME_WORDS["tens"])}
STOPS = frozenset((",", ".", ";", ":", "!", "-", "–", "—", ""))
_FOLLOWS = frozenset(TIME_WORDS["follows"]) | STOPS
_COMPACT = re.compile(r"(\d+)([a-z]+)(?:(\d+)([a-z]*))?")
_SHORT_NAME = re.compile(r"[a-z]+(?:_t)?\d+")

_BORDERS = frozenset((*STOPS, "?", "(", ")", *TIME_WORDS["borders"]))
_FILLERS = frozenset((*TIME_WORDS["joints"], *TIME_WORDS["fillers"]))
_REPORTING = frozenset(TIME_WORDS["told"])
_PAST = frozenset(TIME_WORDS["past"])
_ALONE = frozenset(TIME_WORDS["alone"])
_OF_THE_HOUR = frozenset(TIME_WORDS["of_the_hour"])
_LEADS = frozenset(TIME_WORDS["leads"])
FOUR_DIGITS = re.compile(r"(?:[01]\d|2[0-3])[0-5]\d(?:h|hrs|z)?")
"""A time of day without a colon: 1645, 0900z."""
NAMED = frozenset((*ASSETS, *KIND_WORDS))
"""The words for assets; a number after such a word belongs to the asset."""


@dataclass(frozen=True)
class ClockTime:
    """A time of day; `settled` is True if it is clear which half of the day is meant."""

    at: time
    settled: bool
    day: date | None = None
    utc: bool = False
    bare: bool = False
    """True if the time is only a number: *at nine*."""


def read_clock(
    reader: Reader, now: datetime, *, led: bool, day: date | None = None, half: str = ""
) -> ClockTime | None:
    """Read a time of day.

    `led` is True after a word such as *at*. Without such a word, the form itself must show that it
    is a time.
    """
    reading = _time_of_day(reader, led=led)
    if reading is None:
        return None
    hour, minute, second, settled, plain = reading
    part = reader.take(*TIME_WORDS["morning"], *TIME_WORDS["evening"])
    half = half or ("am" if part in TIME_WORDS["morning"] else "pm" if part else "")
    reader.take(*TIME_WORDS["exact"])
    utc = bool(reader.take(*TIME_WORDS["utc"]))
    day = day or _day_of(part, now)
    if day is None:
        day, other = read_day(reader, now)
        half = half or other
    follows = reader.word() in _FOLLOWS or _SHORT_NAME.fullmatch(reader.word())
    if plain and not half and day is None and not (led and follows):
        return None
    if half and 1 <= hour <= 12:
        hour = hour % 12 + (12 if half == "pm" else 0)
        settled = True
    if hour > 23 or minute > 59 or second > 59:
        return None
    return ClockTime(time(hour, minute, second), settled, day, utc, bare=plain and not half)


def _time_of_day(  # noqa: PLR0911 - one for each way to say it
    reader: Reader, *, led: bool
) -> tuple[int, int, int, bool, bool] | None:
    """Return the hour, minute and second of a time, and two flags; None if there is no time.

    The flags are True if the half of the day is settled, and if the time is only a number.
    """
    if led and reader.take(*TIME_WORDS["noon"]):
        return 12, 0, 0, True, False
    if led and reader.take(*TIME_WORDS["midnight"]):
        return 0, 0, 0, True, False
    if radio := _radio_clock(reader, led=led):
        return radio
    if clock := _spoken_clock(reader):
        return clock
    word = reader.word()
    if whole := re.fullmatch(r"(\d\d?)h(\d\d)?", word):
        reader.at += 1
        return int(whole[1]), int(whole[2] or 0), 0, True, False
    if whole := re.fullmatch(r"(\d\d?)([ap])m?" if led else r"(\d\d?)([ap])m", word):
        reader.at += 1
        return int(whole[1]) % 12 + 12 * (whole[2] == "p"), 0, 0, True, False
    if whole := re.fullmatch(r"([01]\d|2[0-3])([0-5]\d)(h|hrs|z)?", word):
        reader.at += 1
        is_time = bool(whole[3] or reader.take("hrs", "hours", "hr"))
        return (int(whole[1]), int(whole[2]), 0, True, False) if led or is_time else None
    if re.fullmatch(r"\d\d?", word):
        return _digital(reader, word, led=led)
    number = read_number(reader)
    if not led or not 1 <= number <= 12:
        return None
    oclock = bool(reader.take(*TIME_WORDS["oclock"]))
    minute = 0 if oclock else _minutes_after_hour(reader)
    return int(number), minute, 0, False, not oclock and not minute


def _digital(reader: Reader, word: str, *, led: bool) -> tuple[int, int, int, bool, bool] | None:
    """Read *16:45*, *16:45:30*, *4.30*, *4 o'clock*, *4*."""
    reader.at += 1
    halved = re.fullmatch(r"([0-5]\d)([ap])m?", reader.word(1)) if reader.word() == ":" else None
    if halved and _close(reader):
        reader.at += 2
        return int(word) % 12 + 12 * (halved[2] == "p"), int(halved[1]), 0, True, False
    parts: list[int] = []
    for marks in ((":", "."), (":",)):
        if reader.word() in marks and re.fullmatch(r"\d\d", reader.word(1)) and _close(reader):
            if reader.word() == "." and not led:
                break
            parts.append(int(reader.word(1)))
            reader.at += 2
        else:
            break
    spaced = led and not parts and len(word) == 2 and re.fullmatch(r"[0-5]\d", reader.word())
    if spaced and reader.word(1) not in _UNIT_S:
        parts.append(int(reader.word()))
        reader.at += 1
    minute, second = (*parts, 0, 0)[:2]
    oclock = not parts and led and bool(reader.take(*TIME_WORDS["oclock"]))
    settled = len(word) == 2 if parts else int(word) > 12
    if not (led or parts or oclock or reader.word() in ("am", "pm", "a", "p")):
        return None
    return int(word), minute, second, settled, not parts and not oclock


def _close(reader: Reader) -> bool:
    """Return whether no space separates the sign at the cursor from the words around it."""
    before, sign, after = reader.tokens[reader.at - 1 : reader.at + 2]
    return before.end == sign.start and sign.end == after.start


def _spoken_clock(reader: Reader) -> tuple[int, int, int, bool, bool] | None:
    """Read *half past nine*, *quarter to four*, *twenty past eight*."""
    start = reader.at
    reader.take("a")
    minute = (
        30.0 if reader.take("half") else 15.0 if reader.take("quarter") else read_number(reader)
    )
    reader.take("minutes", "min")
    way = reader.take("past", "after", "to", "before")
    hour = read_number(reader) if way and 0 < minute < 60 else -1.0
    if not 1 <= hour <= 23:
        reader.at = start
        return None
    reader.take(*TIME_WORDS["oclock"])
    total = int(hour) * 60 + int(minute if way in ("past", "after") else -minute)
    return total // 60 % 24, total % 60, 0, hour > 12, False


def _radio_clock(reader: Reader, *, led: bool) -> tuple[int, int, int, bool, bool] | None:
    """Read a 24-hour time as spoken on a radio: *seventeen hundred hours*, *oh six thirty*.

    Without a word such as *at* before it, *two hundred* is a time only if *hours* follows.
    """
    start = reader.at
    zero = bool(reader.take(*TIME_WORDS["leading_zero"]))
    hour = -1.0 if reader.word().isdecimal() else read_number(reader)
    limit = 9 if zero else 23
    if not 0 <= hour <= limit:
        reader.at = start
        return None
    minute = 0.0 if reader.take(*TIME_WORDS["hundred"]) else -1.0
    if minute < 0 and zero and not reader.word().isdecimal():
        minute = read_number(reader)
        minute = minute if 10 <= minute <= 59 and reader.word() not in _UNIT_S else -1.0
    is_time = bool(reader.take("hours", "hrs", "hr"))
    ends = reader.word() in STOPS
    if minute < 0 or not (is_time or zero or led or (ends and hour >= 10)):
        reader.at = start
        return None
    return int(hour), int(minute), 0, True, False


def read_minute_of_hour(reader: Reader) -> tuple[int, bool] | None:
    """Read *five past each hour* or *top of the hour*: return the minute, and whether it recurs."""
    start = reader.at
    reader.take("the")
    if place := reader.take("top of", "bottom of"):
        minute = 0.0 if place == "top of" else 30.0
    else:
        reader.take("a")
        minute = {"half": 30.0, "quarter": 15.0}.get(reader.word(), -1.0)
        if minute > 0:
            reader.at += 1
        else:
            minute = read_number(reader)
            reader.take("minutes", "mins", "min")
        way = reader.take("past", "after", "to", "before")
        minute = -1.0 if not way else minute if way in ("past", "after") else 60.0 - minute
    determiner = reader.take("each", "every", "the") if 0 <= minute < 60 else ""
    reader.take("full")
    if not determiner or not reader.take("hour"):
        reader.at = start
        return None
    return int(minute), determiner != "the"


def _minutes_after_hour(reader: Reader) -> int:
    """Read the minutes in *nine thirty*; return 0 if there are none."""
    start = reader.at
    reader.take("oh", "o")
    number = read_number(reader)
    if 1 <= number <= 59 and reader.word() not in _UNIT_S:
        return int(number)
    reader.at = start
    return 0


def read_day(reader: Reader, now: datetime) -> tuple[date | None, str]:
    """Read *tomorrow*, *tonight* or *on monday*: return the day, and its half: '', 'am' or 'pm'."""
    start = reader.at
    if word := reader.take(*TIME_WORDS["today"], *TIME_WORDS["tomorrow"]):
        half = (
            "am" if word in TIME_WORDS["morning"] else "pm" if word in TIME_WORDS["evening"] else ""
        )
        return _day_of(word, now), half
    if reader.take("yesterday"):
        return now.date() - timedelta(days=1), ""
    reader.take("on", "next", "this")
    if day := reader.take_in(WEEKDAYS):
        return next_weekday(day, now), ""
    reader.at = start
    return None, ""


def _day_of(word: str, now: datetime) -> date | None:
    if word in TIME_WORDS["tomorrow"]:
        return now.date() + timedelta(days=1)
    return now.date() if word in TIME_WORDS["today"] else None


def next_weekday(word: str, now: datetime) -> date:
    """Return the first day after today that has this name."""
    ahead = (WEEKDAYS.index(word) - now.weekday() - 1) % 7 + 1
    return now.date() + timedelta(days=ahead)


def read_duration(reader: Reader) -> float:
    """Read *five minutes*, *1 h 15 min*, *an hour and a half*: return its seconds; 0 if none."""
    total, start, last = 0.0, reader.at, DAY_S * 400
    while (seconds := _one_duration(reader)) and seconds < last:
        # Each part must have a smaller unit than the part before it: *every 2 minutes, one minute
        # at each gate* has two durations.
        total, start = total + seconds, reader.at
        last = 0.0 if reader.word() == "," else _UNIT_S.get(reader.word(-1), 0.0)
        reader.take("and")
    reader.at = start
    if total and reader.take("and a half"):
        total += 0.5 * _UNIT_S[reader.tokens[reader.at - 4].word]
    return total


def _one_duration(reader: Reader) -> float:
    start = reader.at
    compact = _COMPACT.fullmatch(reader.word())
    if compact and compact[2] in _UNIT_S and (not compact[4] or compact[4] in _UNIT_S):
        reader.at += 1
        rest = float(compact[3] or 0) * _UNIT_S.get(compact[4] or "min", 0.0)
        return float(compact[1]) * _UNIT_S[compact[2]] + rest
    if reader.take("half an", "half a", "half"):
        share = 0.5
    elif reader.take("a quarter of an", "quarter of an", "a quarter", "quarter"):
        share = 0.25
    elif reader.take("a couple of"):
        share = 2.0
    else:
        share = read_number(reader)
        share = 1.0 if share < 0 and reader.take("a", "an") else share
        share += 0.5 if share > 0 and reader.take("and a half") else 0.0
    seconds = read_unit(reader) if share > 0 else 0.0
    if not seconds:
        reader.at = start
    return share * seconds


def read_unit(reader: Reader) -> float:
    """Read a unit of time and return its seconds; 0 if there is none."""
    word = reader.take_in(_UNIT_S.keys())
    return _UNIT_S[word] if word else 0.0


def read_number(reader: Reader) -> float:
    """Read a number in digits or in words up to 99; return -1 if there is none."""
    word = reader.word()
    tens, _, ones = word.partition("-")
    if tens in _TENS and (not ones or number_of(ones) in range(1, 10)):
        reader.at += 1
        unit = number_of(ones) if ones else number_of(reader.word())
        if not ones and unit in range(1, 10) and not reader.word().isdecimal():
            reader.at += 1
            return float(_TENS[tens] + unit)
        return float(_TENS[tens] + (unit if ones else 0))
    number = number_of(word)
    if number >= 0 and len(word) <= 9:
        reader.at += 1
    return float(number)


def duration_words(seconds: float) -> str:
    """Return a duration in words: *10 minutes*, *1 hour 15 minutes*."""
    parts: list[str] = []
    for name, size in (("day", DAY_S), ("hour", 3600.0), ("minute", 60.0), ("second", 1.0)):
        number, seconds = int(seconds // size), seconds % size
        if number:
            parts.append(f"{number} {name}{'s' * (number > 1)}")
    return " ".join(parts) or "0 seconds"


def is_of_order(
    world: World, tokens: Sequence[WordToken], spans: Sequence[tuple[int, int]], first: int
) -> bool:
    """Return whether the words around the time phrase at `first` ask for something.

    They do if they mention an asset or contain a verb of orders, but not if they report a fact.
    """
    timed = {at for start, end in spans for at in range(start, end)}
    start = last = first
    while start > 0 and (start - 1 in timed or tokens[start - 1].word not in _BORDERS):
        start -= 1
    while last < len(tokens) and (last in timed or tokens[last].word not in _BORDERS):
        last += 1
    around = [at for at in range(start, last) if at not in timed]
    around = [at for at in around if tokens[at].word not in _FILLERS | _OF_THE_HOUR | _LEADS]
    around = [at for at in around if read_number(Reader(tokens, at)) < 0]
    if not around:
        return True
    for at in around:
        if at < first and tokens[at].word in _REPORTING and tokens[at + 1].word != "to":
            return False
    clause = " ".join(tokens[at].written for at in around)
    words = {token.word.removesuffix("s") for token in read_tokens(link_names(world, clause))}
    if words & {*ASSETS, *KIND_WORDS, *(name.lower() for name in world.assets), *EVERYBODY}:
        return True
    return any(verb.plain or verb.start == 0 for verb in find_verbs(clause))


def unread_times(world: World, text: str) -> tuple[str, ...]:
    """Return the expressions of time in an order that were not understood.

    A time of something else, such as *the guard changes in an hour*, is not included.
    """
    tokens = read_tokens(text)
    spans, at = list[tuple[int, int]](), 0
    while at < len(tokens):
        reader = Reader(tokens, at)
        past = reader.word(-1) == "since"
        if _names_time(reader) and not past and reader.word() not in _PAST:
            spans.append((at, reader.at))
        at = max(reader.at, at + 1)
    return tuple(
        text[tokens[first].start : tokens[end - 1].end]
        for first, end in spans
        if is_of_order(world, tokens, spans, first)
    )


def names_time(text: str) -> bool:
    """Return whether `text` contains a time of day or a duration."""
    tokens = read_tokens(text)
    for at in range(len(tokens)):
        reader = Reader(tokens, at)
        led = reader.word(-1) == "at"
        if _names_time(reader) or _time_of_day(Reader(tokens, at), led=led) is not None:
            return True
    return False


def _names_time(reader: Reader) -> bool:
    """Read words that always mean a time: *ten minutes*, *16:45*, *1645*, *midnight*.

    Three forms do not count: *a second* may mean another asset, *a minute* need not mean a time,
    and *robot 3s* is a possessive.
    """
    loose = reader.word() in ("a", "an") or reader.word()[-1:] == "s"
    if not loose and read_duration(reader) > 0.0:
        return True
    if reader.word(1) == ":" and reader.word().isdecimal() and reader.word(2).isdecimal():
        reader.at += 3
        return True
    alone = reader.word() in _ALONE or FOUR_DIGITS.fullmatch(reader.word()) is not None
    if not alone and reader.word().isdecimal() and reader.word(-1) not in NAMED:
        # *In 5* and *5 past* have a number beside a word for times, and no noun after it.
        after = reader.word(1)
        ends = reader.word(-1) in _LEADS and (after in STOPS or after in _OF_THE_HOUR)
        alone = ends or after in ("past", "sharp", "hundred")
    reader.at += alone
    return alone
