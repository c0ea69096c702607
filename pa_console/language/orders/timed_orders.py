"""The times of an order: a moment, an interval, an end, a stay; the remaining text is the order.

Examples are *at 16:45*, *in five minutes*, *every full hour until 18:00*, and *for ten minutes and
then back*. Times are those of the station's clock and time zone. Each phrase is cut out of the
text, and the remaining text is read like any order. The operator is asked about a time that can
mean two moments, and about a time in the past.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, date, datetime, time, timedelta
from types import MappingProxyType

from pa_console.language.clock_words import (
    TIME_WORDS,
    ClockTime,
    duration_words,
    read_duration,
    unread_times,
)
from pa_console.language.orders.time_phrases import TimePhrases, aligned, read_phrases
from pa_console.language.references.conversation import Unclear
from pa_console.language.references.reader import Reader, read_tokens
from pa_console.schema.mission import Schedule
from pa_console.schema.world import World

SHORTEST_S = 60.0
"""The shortest interval of a repeating order, in seconds, unless a setting changes it."""
MOST_AHEAD = timedelta(days=31)
"""The longest time from now to the beginning of an order."""
JUST_S = 1.0
"""The seconds for which a clock time that has just passed still means the present moment."""


@dataclass(frozen=True)
class ReadTimed:
    """A timed order: its moments, and the order that each of them starts."""

    schedule: Schedule
    order: str


def read_timed(
    world: World,
    text: str,
    now: datetime,
    answers: Mapping[str, str] = MappingProxyType({}),
    shortest_s: float = SHORTEST_S,
) -> ReadTimed | Unclear | None:
    """Return the timed order in `text`, a question about its times, or None without a time.

    `now` is the station's local time; `answers` are the operator's earlier answers about times in
    the text.
    """
    for words, meaning in answers.items():
        text = text.replace(words, meaning, 1)
    tokens = read_tokens(text)
    phrases = read_phrases(world, text, tokens, now)
    if phrases is None:
        return None
    order = _rest(text, phrases.cut)
    if not order:
        return Unclear("", "What is to be done then? Only the time was given.")
    if left := _second_clock(world, order):
        return Unclear("", f"“{left}” is another time: give a separate order for each time.")
    schedule = _schedule(phrases, now, shortest_s)
    return schedule if isinstance(schedule, Unclear) else ReadTimed(schedule, order)


def _second_clock(world: World, order: str) -> str:
    """Return a clock time that is left in an order after its times were read; '' if there is none.

    A duration may belong to the task: *one minute at each gate*.
    """
    for words in unread_times(world, order):
        reader = Reader(read_tokens(words))
        if not read_duration(reader) or not reader.over:
            return words
    return ""


def _schedule(  # noqa: PLR0911 - one for each possible problem
    phrases: TimePhrases, now: datetime, shortest_s: float
) -> Schedule | Unclear:
    """Return the schedule of the order, or a question if its times cannot be used."""
    latest = phrases.until is not None and not phrases.every_s and phrases.until[0].lower()
    if latest and latest.startswith(TIME_WORDS["last_at"]):
        phrases.vague = phrases.until[0] if phrases.until else ""
    if phrases.vague:
        question = "at what time, or in how many minutes?"
        return Unclear("", f"“{phrases.vague}” gives no exact starting time: {question}")
    if len(phrases.starts) > 1:
        both = " and ".join(f"“{words}”" for words, _ in phrases.starts)
        return Unclear("", f"{both} are two times: give a separate order for each.")
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
        return Unclear(
            "", f"the order would end at {until:%H:%M}, before it begins at {start:%H:%M}."
        )
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


def _first(phrases: TimePhrases, now: datetime) -> datetime | Unclear:
    if phrases.starts:
        words, first = phrases.starts[0]
        if isinstance(first, datetime):
            return first
        at = _moment(words, first, phrases, now)
        if isinstance(at, Unclear) or phrases.minute is None:
            return at
        return aligned(at, phrases.minute)
    if phrases.minute is not None:
        return aligned(now, phrases.minute)
    if phrases.day is not None and phrases.day != now.date():
        return Unclear("", "At what time of that day? Say, for example: tomorrow at 16:45.")
    return now


def _moment(
    words: str, clock: ClockTime, phrases: TimePhrases, now: datetime
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


def _end(phrases: TimePhrases, start: datetime, now: datetime) -> datetime | Unclear | None:
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
