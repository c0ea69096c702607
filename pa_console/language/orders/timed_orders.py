"""The times of an order: a moment, an interval, an end, a stay; the remaining text is the order.

Examples are *at 16:45*, *in five minutes*, *every full hour until 18:00*, and *for ten minutes and
then back*. Times are those of the station's clock and time zone. Each phrase is cut out of the
text, and the remaining text is read like any order. The operator is asked about a time that can
mean two moments, and about one in the past.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, date, datetime, time, timedelta
from types import MappingProxyType

from pa_console.language.clock_words import (
    FOUR_DIGITS,
    NAMED,
    STOPS,
    TIME_WORDS,
    WEEKDAYS,
    ClockTime,
    duration_words,
    is_of_order,
    next_weekday,
    read_clock,
    read_day,
    read_duration,
    read_minute_of_hour,
    read_number,
    read_unit,
    unread_times,
)
from pa_console.language.references.conversation import Unclear
from pa_console.language.references.reader import Reader, WordToken, read_tokens
from pa_console.schema.mission import DAY_S, Schedule
from pa_console.schema.world import World

SHORTEST_S = 60.0
"""The shortest interval of a repeating order, seconds, unless a setting changes it."""
MOST_AHEAD = timedelta(days=31)
"""How far ahead an order may begin."""
JUST_S = 1.0
"""How long a clock time that has passed still means the present moment, seconds."""

_FREQUENT = {"hourly": 3600.0, "half-hourly": 1800.0, "quarter-hourly": 900.0, "daily": DAY_S}
_TO_BASE = frozenset(("base", "home", "rtb", "return", "returns"))
_NOT_ALONE = frozenset(TIME_WORDS["not_alone"])
_REPEATS = {"twice": 2, "thrice": 3, "once": 1}
_ON_THE = (("on the full hour", 0), ("on the hour", 0), ("on the half hour", 30),
           ("on the half-hour", 30), ("at the full hour", 0), ("at each full hour", 0))  # fmt: skip


@dataclass(frozen=True)
class ReadTimed:
    """A timed order: its moments, and the order that each of them starts."""

    schedule: Schedule
    order: str


@dataclass
class _TimePhrases:
    """The phrases read so far of a `text`."""

    text: str
    starts: list[tuple[str, ClockTime | datetime]] = field(
        default_factory=list[tuple[str, "ClockTime | datetime"]]
    )
    every_s: float = 0.0
    minute: int | None = None
    """The minute of the hour at which the moments are."""
    until: tuple[str, ClockTime] | None = None
    during_s: float = 0.0
    times: int = 0
    to_base: bool = False
    """True if the asset goes to the base after its stay, instead of its former place."""
    day: date | None = None
    half: str = ""
    """The half of the day in which the moments are: 'am', 'pm', or '' if it is not given."""
    vague: str = ""
    """Words of time that define no moment: *in a few minutes*."""
    cut: list[tuple[int, int]] = field(default_factory=list[tuple[int, int]])

    @property
    def timed(self) -> bool:
        """True if the text has a time."""
        return bool(
            self.starts or self.every_s or self.until or self.during_s or self.day or self.vague
        )


def read_timed(
    world: World,
    text: str,
    now: datetime,
    answers: Mapping[str, str] = MappingProxyType({}),
    shortest_s: float = SHORTEST_S,
) -> ReadTimed | Unclear | None:
    """Read an order with times: return it, a question about its times, or None if it has no times.

    `now` is the station's local time; `answers` are the operator's earlier answers about times in
    the text.
    """
    for words, meaning in answers.items():
        text = text.replace(words, meaning, 1)
    tokens = read_tokens(text)
    phrases = _phrases(world, text, tokens, now)
    if phrases is None:
        return None
    order = _rest(text, phrases.cut)
    if not order:
        return Unclear("", "What is to be done then? Only the time was given.")
    if left := _second_clock(world, order):
        return Unclear("", f"“{left}” is one more time: give one order for each moment.")
    schedule = _schedule(phrases, now, shortest_s)
    return schedule if isinstance(schedule, Unclear) else ReadTimed(schedule, order)


def _second_clock(world: World, order: str) -> str:
    """Return a clock time that remains in an order after its times were read; '' for none.

    A duration may belong to the task: *one minute at each gate*.
    """
    for words in unread_times(world, order):
        reader = Reader(read_tokens(words))
        if not read_duration(reader) or not reader.over:
            return words
    return ""


def _phrases(
    world: World, text: str, tokens: tuple[WordToken, ...], now: datetime
) -> _TimePhrases | None:
    """Return the times, intervals and ends in the text; None if it has none.

    A time of something else, such as *the storm will hit in an hour*, is not a time of the order.
    """
    spans, at = list[tuple[int, int]](), 0
    while at < len(tokens):
        reader = Reader(tokens, at)
        is_time = _phrase(reader, _TimePhrases(text), now)
        if is_time:
            spans.append((at, reader.at))
        at = reader.at if is_time else at + 1
    phrases = _TimePhrases(text)
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
    """Return where a phrase begins, with the joining words before it: *and then every hour*."""
    while at > 0 and tokens[at - 1].word in ("and", "then", ",", "but", "once"):
        at -= 1
    return tokens[at].start


def _phrase(reader: Reader, phrases: _TimePhrases, now: datetime) -> bool:
    """Read one phrase of time here; return False if there is none."""
    start = reader.at
    for read in (_read_every, _read_window, _read_until, _read_start, _read_during, _read_vague):
        if read(reader, phrases, now):
            while reader.word(1) != "the" and reader.take(*TIME_WORDS["onwards"]):
                pass
            return True
        reader.at = start
    return False


def _cut_later(tokens: tuple[WordToken, ...], phrases: _TimePhrases, name: str) -> None:
    """Read a phrase that counts only beside a time: *four times*, or *then back* at the end."""
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
    """Read *and then back* or *after that it returns to base* at the end; return the words."""
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


# ------------------------------------------------------------------ the phrases


def _read_every(reader: Reader, phrases: _TimePhrases, now: datetime) -> bool:  # noqa: PLR0911
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


def _read_until(reader: Reader, phrases: _TimePhrases, now: datetime) -> bool:
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


def _read_window(reader: Reader, phrases: _TimePhrases, now: datetime) -> bool:
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


def _read_vague(reader: Reader, phrases: _TimePhrases, now: datetime) -> bool:
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


def _read_start(reader: Reader, phrases: _TimePhrases, now: datetime) -> bool:
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
            (_words_from(phrases, reader, first), _aligned(now, minute_of_hour[0]))
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
    """Read a number of minutes, *in 5* at the end of a clause or *T+15*; return seconds."""
    number = read_number(reader) if reader.word().isdecimal() else -1.0
    return 60.0 * number if number > 0 and not (ends and reader.word() not in STOPS) else 0.0


def _stands_alone(reader: Reader, now: datetime) -> str:
    """Return "at" if there is a time here that needs no such word: *RTB 2130*, *midnite: ...*.

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


def _read_during(reader: Reader, phrases: _TimePhrases, now: datetime) -> bool:  # noqa: ARG001
    """Read *for ten minutes*, *for the next two hours*, and *ten minutes* before *then back*."""
    led = reader.take(*TIME_WORDS["during"])
    if not led and (reader.at == 0 or reader.word(-1) not in STOPS):
        return False
    seconds = read_duration(reader)
    if not led and not (seconds and _way_back(Reader(reader.tokens, reader.at))):
        return False
    phrases.during_s = seconds
    return phrases.during_s > 0.0


def _words_from(phrases: _TimePhrases, reader: Reader, first: int) -> str:
    return phrases.text[reader.tokens[first].start : reader.tokens[reader.at - 1].end]


# ------------------------------------------------------------------ the schedule


def _schedule(  # noqa: PLR0911 - one line for each thing that can be wrong
    phrases: _TimePhrases, now: datetime, shortest_s: float
) -> Schedule | Unclear:
    """Return the schedule of the order, or the question why its times cannot be used."""
    latest = phrases.until is not None and not phrases.every_s and phrases.until[0].lower()
    if latest and latest.startswith(TIME_WORDS["last_at"]):
        phrases.vague = phrases.until[0] if phrases.until else ""
    if phrases.vague:
        return Unclear(
            "", f"“{phrases.vague}” names no moment: at what time, or in how many minutes?"
        )
    if len(phrases.starts) > 1:
        both = " and ".join(f"“{words}”" for words, _ in phrases.starts)
        return Unclear("", f"{both} are two moments: give one order for each of them.")
    start = _first(phrases, now)
    if isinstance(start, Unclear):
        return start
    if 0.0 < phrases.every_s < shortest_s:
        interval = f"every {duration_words(phrases.every_s)}"
        least = duration_words(shortest_s)
        return Unclear("", f"{interval} is too often: at most every {least} (shortest_interval_s).")
    if start > now + MOST_AHEAD:
        return Unclear("", f"{start:%d %B} is too far ahead: at most {MOST_AHEAD.days} days.")
    until = _end(phrases, start, now)
    if isinstance(until, Unclear):
        return until
    if until is not None and until <= start:
        return Unclear("", f"it would end at {until:%H:%M} before it begins at {start:%H:%M}.")
    if phrases.every_s:
        if until is None and phrases.during_s:
            until = start + timedelta(seconds=phrases.during_s)
        return Schedule(
            start=start,
            at_once=start == now,
            every_s=phrases.every_s,
            until=until,
            times=phrases.times,
        )
    return Schedule(
        start=start,
        at_once=start == now,
        stay_s=phrases.during_s,
        leave=until,
        to_base=phrases.to_base,
    )


def _first(phrases: _TimePhrases, now: datetime) -> datetime | Unclear:
    if phrases.starts:
        words, first = phrases.starts[0]
        if isinstance(first, datetime):
            return first
        at = _moment(words, first, phrases, now)
        if isinstance(at, Unclear) or phrases.minute is None:
            return at
        return _aligned(at, phrases.minute)
    if phrases.minute is not None:
        return _aligned(now, phrases.minute)
    if phrases.day is not None and phrases.day != now.date():
        return Unclear("", "At what time of that day? Say for example: tomorrow at 16:45.")
    return now


def _aligned(now: datetime, minute: int) -> datetime:
    """Return the next moment at this minute of an hour."""
    at = now.replace(minute=minute, second=0, microsecond=0)
    return at if at >= now else at + timedelta(hours=1)


def _moment(
    words: str, clock: ClockTime, phrases: _TimePhrases, now: datetime
) -> datetime | Unclear:
    """Return the moment of a clock time, or a question if it has passed or can mean two moments."""
    day = clock.day or phrases.day
    at = _on(day or now.date(), clock.at, now, utc=clock.utc)
    if not clock.settled:
        ways = [at, at + timedelta(hours=12) if at.hour < 12 else at - timedelta(hours=12)]
        ways = [moment if day or moment > now else moment + timedelta(days=1) for moment in ways]
        choices = tuple(_moment_words(moment, now) for moment in sorted(ways) if moment > now)
        if choices:
            question = f"“{words}”: in the morning or in the evening?"
            return Unclear(words, question, choices)
    if at < now - timedelta(seconds=JUST_S):
        if at.hour == at.minute == 0 and not day:
            return at + timedelta(days=1)  # midnight is the end of the day
        if phrases.every_s and not day:
            return at + timedelta(days=1)
        passed = f"{at:%H:%M} has passed: it is {now:%H:%M}. At what time?"
        return Unclear(
            words, passed, (_moment_words(at + timedelta(days=1), now),) * (not clock.day)
        )
    return max(at, now)


def _end(phrases: _TimePhrases, start: datetime, now: datetime) -> datetime | Unclear | None:
    if phrases.until is None:
        return None
    words, clock = phrases.until
    day = clock.day or start.date()
    at = _on(day, clock.at, now, utc=clock.utc)
    if not clock.settled:
        ways = [at, at + timedelta(hours=12) if at.hour < 12 else at - timedelta(hours=12)]
        choices = tuple(f"until {moment:%H:%M}" for moment in sorted(ways) if moment > start)
        return Unclear(words, f"“{words}”: in the morning or in the evening?", choices)
    if at <= start and clock.day is None:
        if not phrases.starts and (at.hour or at.minute):
            return Unclear("", f"{at:%H:%M} has passed: it is {now:%H:%M}. Until when?")
        at += timedelta(days=1)
    return at


def _on(day: date, at: time, now: datetime, *, utc: bool) -> datetime:
    """Return a time of day on `day` in the zone of `now`, with the offset of that day."""
    if utc:
        return datetime.combine(day, at, UTC).astimezone(now.tzinfo)
    if now.tzinfo is UTC:
        return datetime.combine(day, at, UTC)
    return datetime.combine(day, at).astimezone()


def _moment_words(at: datetime, now: datetime) -> str:
    day = "" if at.date() == now.date() else "tomorrow "
    if day and at.date() != now.date() + timedelta(days=1):
        day = f"{at:%A} "
    return f"{day}at {at:%H:%M}" + (f":{at:%S}" if at.second else "")


def schedule_words(schedule: Schedule, now: datetime) -> str:
    """Return a schedule in words: *every 10 minutes from 15:00 until 18:00*."""
    begins = "now" if schedule.at_once else _moment_words(schedule.start, now)
    if schedule.every_s:
        words = f"every {duration_words(schedule.every_s)} from {begins.removeprefix('at ')}"
        if schedule.until is not None:
            words += f" until {_moment_words(schedule.until, now).replace('at ', '')}"
        return words + (f", {schedule.times} times" if schedule.times else "")
    then = "then to base" if schedule.to_base else "then back"
    if schedule.leave is not None:
        return f"{begins}, until {_moment_words(schedule.leave, now).replace('at ', '')}, {then}"
    stay = f", for {duration_words(schedule.stay_s)} in place, {then}"
    return begins + stay * bool(schedule.stay_s)


def _rest(text: str, cut: list[tuple[int, int]]) -> str:
    """Return the text without the time phrases and the punctuation around them."""
    parts, done = list[str](), 0
    for first, last in sorted(cut):
        if first >= done:
            parts.append(text[done:first])
        done = max(done, last)
    left = " ".join((*parts, text[done:]))
    left = re.sub(r"\s+", " ", left)
    left = re.sub(r"\s+([,.;!?])", r"\1", left)
    left = re.sub(r"[,;:]\s*(?=[,.;:])|(?<=[.;,])\s*[,.;]+", "", left)
    left = re.sub(r"^(?:[\s,.;:–—-]|and\b|then\b)+|[\s,;:–—-]+$", "", left)
    return left[:1].upper() + left[1:] if re.search(r"\w", left) else ""
