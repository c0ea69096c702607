"""The phrases of time in an order: *every ten minutes*, *from 3 pm to 5 pm*, *for ten minutes*.

Each phrase is read into `TimePhrases` and cut out of the text; `timed_orders.py` makes a schedule
of them.
"""

import re
from dataclasses import dataclass, field
from datetime import date, datetime, timedelta

from pa_console.language.clock_words import (
    FOUR_DIGITS,
    NAMED,
    STOPS,
    TIME_WORDS,
    WEEKDAYS,
    ClockTime,
    is_of_order,
    next_weekday,
    read_clock,
    read_day,
    read_duration,
    read_minute_of_hour,
    read_number,
    read_unit,
)
from pa_console.language.references.reader import Reader, WordToken
from pa_console.schema.mission import DAY_S
from pa_console.schema.world import World

_FREQUENT = {"hourly": 3600.0, "half-hourly": 1800.0, "quarter-hourly": 900.0, "daily": DAY_S}
_TO_BASE = frozenset(("base", "home", "rtb", "return", "returns"))
_NOT_ALONE = frozenset(TIME_WORDS["not_alone"])
_REPEATS = {"twice": 2, "thrice": 3, "once": 1}
_ON_THE = (("on the full hour", 0), ("on the hour", 0), ("on the half hour", 30),
           ("on the half-hour", 30), ("at the full hour", 0), ("at each full hour", 0))  # fmt: skip


@dataclass
class TimePhrases:
    """The times in a `text`, from the phrases read so far."""

    text: str
    starts: list[tuple[str, ClockTime | datetime]] = field(
        default_factory=list[tuple[str, "ClockTime | datetime"]]
    )
    every_s: float = 0.0
    minute: int | None = None
    """The minute of the hour at which each moment falls."""
    until: tuple[str, ClockTime] | None = None
    during_s: float = 0.0
    times: int = 0
    to_base: bool = False
    """True if the asset goes to the base after its stay, and not back to its former place."""
    day: date | None = None
    half: str = ""
    """The half of the day of all moments: 'am', 'pm', or '' if it is not given."""
    vague: str = ""
    """Words for a time that define no moment: *in a few minutes*."""
    cut: list[tuple[int, int]] = field(default_factory=list[tuple[int, int]])

    @property
    def timed(self) -> bool:
        """True if the text has a time."""
        return bool(
            self.starts or self.every_s or self.until or self.during_s or self.day or self.vague
        )


def read_phrases(
    world: World, text: str, tokens: tuple[WordToken, ...], now: datetime
) -> TimePhrases | None:
    """Return the times, intervals and ends in the text; None if it has none.

    A time of something else, such as *the storm will hit in an hour*, is not a time of the order.
    """
    spans, at = list[tuple[int, int]](), 0
    while at < len(tokens):
        reader = Reader(tokens, at)
        is_time = _phrase(reader, TimePhrases(text), now)
        if is_time:
            spans.append((at, reader.at))
        at = reader.at if is_time else at + 1
    phrases = TimePhrases(text)
    for first, end in spans:
        if is_of_order(world, tokens, spans, first):
            _phrase(Reader(tokens, first), phrases, now)
            phrases.cut.append((_before(tokens, first), tokens[end - 1].end))
    if not phrases.timed:
        return None
    for name in ("times", "back"):
        _cut_later(tokens, phrases, name)
    return phrases


def _before(tokens: tuple[WordToken, ...], at: int) -> int:
    """Return the start of a phrase, including joining words before it: *and then every hour*."""
    while at > 0 and tokens[at - 1].word in ("and", "then", ",", "but", "once"):
        at -= 1
    return tokens[at].start


def _phrase(reader: Reader, phrases: TimePhrases, now: datetime) -> bool:
    """Read one phrase of time at the cursor; return False if there is none."""
    start = reader.at
    for read in (_read_every, _read_window, _read_until, _read_start, _read_during, _read_vague):
        if read(reader, phrases, now):
            while reader.word(1) != "the" and reader.take(*TIME_WORDS["onwards"]):
                pass
            return True
        reader.at = start
    return False


def _cut_later(tokens: tuple[WordToken, ...], phrases: TimePhrases, name: str) -> None:
    """Cut out a phrase that counts only beside a time: *four times*, or *then back* at the end."""
    for at in range(len(tokens)):
        reader = Reader(tokens, at)
        if any(first <= tokens[at].start < last for first, last in phrases.cut):
            continue
        if name == "times" and phrases.every_s and (count := _repeats(reader)):
            phrases.times = count
            reader.take(*TIME_WORDS["onwards"])
        elif name == "back" and not phrases.every_s and (phrases.during_s or phrases.until):
            if not (way := _way_back(reader)):
                continue
            phrases.to_base = bool(_TO_BASE & way)
        else:
            continue
        phrases.cut.append((_before(tokens, at), tokens[reader.at - 1].end))
        return


def _way_back(reader: Reader) -> set[str]:
    """Read *and then back* or *after that it returns to base* at the end; return its words."""
    reader.take(",")
    if not reader.take(*TIME_WORDS["then"]):
        return set()
    first = reader.at
    reader.skip(TIME_WORDS["way_back"])
    words = {token.word for token in reader.tokens[first : reader.at]}
    reader.skip(STOPS)
    return words if reader.over and words & set(TIME_WORDS["back"]) else set()


def _repeats(reader: Reader) -> int:
    count = _REPEATS.get(reader.word(), 0)
    if count:
        reader.at += 1
        return count if count > 1 else 0
    number = read_number(reader)
    return int(number) if number > 0 and reader.take("times") else 0


def _read_every(reader: Reader, phrases: TimePhrases, now: datetime) -> bool:  # noqa: PLR0911
    """Read *every ten minutes*, *hourly*, *on the half hour*, *twice an hour*."""
    for words, minute in _ON_THE:
        if reader.take(words):
            phrases.every_s, phrases.minute = phrases.every_s or 3600.0, minute
            return True
    first = reader.at
    reader.take(*TIME_WORDS["every"], "at", "on")
    led = reader.tokens[reader.at - 1].word if reader.at > first else ""
    minute_of_hour = read_minute_of_hour(reader)
    if minute_of_hour is not None and (minute_of_hour[1] or led in TIME_WORDS["every"]):
        phrases.every_s, phrases.minute = 3600.0, minute_of_hour[0]
        return True
    reader.at = first
    if seconds := _FREQUENT.get(reader.word(), 0.0):
        reader.at += 1
        if reader.at > 1 and reader.word() not in STOPS:
            return False  # an adjective in an order: *for the daily brief*
        phrases.every_s = seconds
        return True
    start = reader.at
    if (count := _repeats_an_hour(reader)) > 0:
        phrases.every_s = 3600.0 / count
        return True
    reader.at = start
    if not reader.take(*TIME_WORDS["every"]):
        return False
    whole = reader.tokens[reader.at - 1].word != "all"
    if whole and reader.take("full hour", "whole hour"):
        phrases.every_s, phrases.minute = 3600.0, 0
        return True
    if whole and (day := reader.take_in(WEEKDAYS)):
        phrases.every_s, phrases.day = 7 * DAY_S, next_weekday(day, now)
        return True
    if whole and (part := reader.take("morning", "afternoon", "evening", "night")):
        phrases.every_s, phrases.half = DAY_S, "am" if part == "morning" else "pm"
        return True
    seconds = read_duration(reader)
    if whole and not seconds:
        seconds = 2.0 * read_unit(reader) if reader.take("other") else read_unit(reader)
        seconds *= 1.5 if reader.take("and a half") else 1.0
    if seconds and reader.take("on the hour", "on the full hour"):
        phrases.minute = 0
    phrases.every_s = seconds or phrases.every_s
    return seconds > 0.0


def _repeats_an_hour(reader: Reader) -> int:
    count = _REPEATS.get(reader.word(), 0)
    if count:
        reader.at += 1
    else:
        number = read_number(reader)
        count = int(number) if number > 0 and reader.take("times") else 0
    return count if count and reader.take(*TIME_WORDS["times_an_hour"]) else 0


def _read_until(reader: Reader, phrases: TimePhrases, now: datetime) -> bool:
    if reader.take(*TIME_WORDS["endless"]):
        return True
    first = reader.at
    joined = reader.word(-1) in (*STOPS, "and", "then")
    if not reader.take(*TIME_WORDS["until"]) and not (
        joined and first > 0 and reader.take(*TIME_WORDS["back_at"])
    ):
        return False
    clock = read_clock(reader, now, led=True)
    if clock is None:
        return False
    phrases.until = _words_from(phrases, reader, first), clock
    return True


def _read_window(reader: Reader, phrases: TimePhrases, now: datetime) -> bool:
    """Read *between 15:00 and 16:00*, *from 3 pm to 5 pm*."""
    first = reader.at
    if not reader.take("between", "from"):
        return False
    start = read_clock(reader, now, led=True)
    middle = reader.at
    if start is None or not reader.take("and", "to"):
        return False
    end = read_clock(reader, now, led=True)
    if end is None:
        return False
    words = phrases.text[reader.tokens[first].start : reader.tokens[middle - 1].end]
    phrases.starts.append((words, start))
    phrases.until = _words_from(phrases, reader, middle), end
    return True


def _read_vague(reader: Reader, phrases: TimePhrases, now: datetime) -> bool:
    """Read a time that defines no moment: *in a few minutes*, *by 16:45*, *at 25:00*."""
    first = reader.at
    if reader.take("by", "before"):
        latest = read_clock(reader, now, led=True)
        if latest is None or latest.bare:
            return False
        phrases.vague = _words_from(phrases, reader, first)
        return True
    if reader.take(*TIME_WORDS["about_when"]) and reader.take(*TIME_WORDS["parts_of_day"]):
        phrases.vague = _words_from(phrases, reader, first)
        return True
    reader.at = first
    led = bool(reader.take("in", "for", "every"))
    is_vague = (
        led and bool(reader.take(*TIME_WORDS["vague"], "0", "zero")) and read_unit(reader) > 0.0
    )
    if not is_vague and (reader.take(*TIME_WORDS["at"]) or first == 0):
        # An invalid clock time: *at 25:00* must not become an order for now.
        parts = reader.word(), reader.word(1), reader.word(2)
        is_vague = parts[1] == ":" and parts[0].isdecimal() and parts[2].isdecimal()
        reader.at += 3 * is_vague
    if is_vague:
        phrases.vague = _words_from(phrases, reader, first)
    return is_vague


def _read_start(reader: Reader, phrases: TimePhrases, now: datetime) -> bool:
    """Read *at 16:45*, *tonight at 11*, *in five minutes*, *five minutes from now*."""
    first = reader.at
    if reader.take("starting now", "beginning now"):
        phrases.starts.append(("now", now))
        return True
    if way := reader.take(*TIME_WORDS["after"]):
        # In the middle of an order, *wait ten minutes* is part of the task.
        seconds = read_duration(reader) if first == 0 or not way.startswith("wait") else 0.0
        if not seconds and way in ("in", "t plus", "t +"):
            seconds = _bare_minutes(reader, ends=way == "in")
        if seconds:
            reader.take("time", *TIME_WORDS["hence"])
            phrases.starts.append(
                (_words_from(phrases, reader, first), now + timedelta(seconds=seconds))
            )
        return seconds > 0.0
    if (seconds := read_duration(reader)) and reader.take(*TIME_WORDS["hence"]):
        phrases.starts.append(
            (_words_from(phrases, reader, first), now + timedelta(seconds=seconds))
        )
        return True
    reader.at = first
    reader.take(*TIME_WORDS["at"], "on")
    if (minute_of_hour := read_minute_of_hour(reader)) is not None and not minute_of_hour[1]:
        phrases.starts.append(
            (_words_from(phrases, reader, first), aligned(now, minute_of_hour[0]))
        )
        return True
    reader.at = first
    led = reader.take(*TIME_WORDS["at"]) or _stands_alone(reader, now)
    day, half = read_day(reader, now)
    half = half or phrases.half
    if day is not None and not led:
        after = reader.at
        reader.take(",")
        led = reader.take(*TIME_WORDS["at"])
        reader.at = reader.at if led else after
    clock = read_clock(reader, now, led=bool(led) or day is not None, day=day, half=half)
    if clock is None or (led == "from" and clock.bare):
        tomorrow = day is not None and day > now.date() and not led
        if tomorrow and (first == 0 or reader.word() in STOPS) and reader.word(-1) not in WEEKDAYS:
            phrases.day = day
            return True
        return False
    if not led and first > 0 and day is None and reader.word() not in STOPS:
        return False
    phrases.starts.append((_words_from(phrases, reader, first), clock))
    return True


def _bare_minutes(reader: Reader, *, ends: bool) -> float:
    """Read a number of minutes, as in *T+15* or, at the end of a clause, *in 5*; return seconds."""
    number = read_number(reader) if reader.word().isdecimal() else -1.0
    return 60.0 * number if number > 0 and not (ends and reader.word() not in STOPS) else 0.0


def _stands_alone(reader: Reader, now: datetime) -> str:
    """Return "at" if a time that does not need this word is next: *RTB 2130*, *midnite: ...*.

    Such a time has four digits, is *16 30*, noon or midnight, and begins or ends a clause.
    """
    digits = FOUR_DIGITS.fullmatch(reader.word()) or (
        re.fullmatch(r"[012]\d", reader.word()) and re.fullmatch(r"[0-5]\d", reader.word(1))
    )
    trial = Reader(reader.tokens, reader.at)
    if not digits and not trial.take(*TIME_WORDS["noon"], *TIME_WORDS["midnight"]):
        return ""
    before = reader.word(-1)
    if before.removesuffix("s") in NAMED or before in _NOT_ALONE:
        return ""
    trial.at = reader.at
    clock = read_clock(trial, now, led=True)
    borders = reader.at == 0 or before in STOPS or trial.word() in STOPS
    return "at" if clock is not None and not clock.bare and borders else ""


def _read_during(reader: Reader, phrases: TimePhrases, now: datetime) -> bool:  # noqa: ARG001
    """Read *for ten minutes*, *for the next two hours*, and *ten minutes* before *then back*."""
    led = reader.take(*TIME_WORDS["during"])
    if not led and (reader.at == 0 or reader.word(-1) not in STOPS):
        return False
    seconds = read_duration(reader)
    if not led and not (seconds and _way_back(Reader(reader.tokens, reader.at))):
        return False
    phrases.during_s = seconds
    return phrases.during_s > 0.0


def _words_from(phrases: TimePhrases, reader: Reader, first: int) -> str:
    return phrases.text[reader.tokens[first].start : reader.tokens[reader.at - 1].end]


def aligned(now: datetime, minute: int) -> datetime:
    """Return the next moment that falls on this minute of an hour."""
    at = now.replace(minute=minute, second=0, microsecond=0)
    return at if at >= now else at + timedelta(hours=1)
