"""Parses a position in a recording: a time, a step, an event, a part of it."""

import re
from datetime import timedelta

from pa_console.session.recording import Player

ACCEPTED = (
    "1:30 into the recording   s1:30 the session's own clock   @14:05:30 the time of day\n"
    "+30 -30 seconds from here   #120 event 120   50% of it   end"
)
"""The accepted forms, for the operator."""


def read_position(text: str, player: Player) -> int:
    """Return how many events are played at the moment that `text` names.

    Raises ValueError that says what may be typed.
    """
    timeline, text = player.recording.timeline, "".join(text.split()).lower()
    if text == "end":
        return len(timeline)
    if found := re.fullmatch(r"#(\d{1,12})", text):
        return min(int(found[1]), len(timeline))
    if (found := re.fullmatch(r"(\d{1,3}(?:\.\d+)?)%", text)) and float(found[1]) <= 100:
        return timeline.count_until(timeline.duration * float(found[1]) / 100)
    found = re.fullmatch(r"([-+s@]?)((?:\d{1,6}:){0,2}\d{1,6}(?:\.\d+)?)", text)
    if found is None:
        raise ValueError(f"“{text}” is no moment; write one like these:\n{ACCEPTED}")
    sign, seconds = found[1], _seconds(found[2])
    if sign == "s":
        if not timeline.ticks_per_s:
            raise ValueError("this recording has no telemetry, so it knows no clock of its own")
        return timeline.count_until_tick(seconds * timeline.ticks_per_s)
    if sign == "@":
        return timeline.count_until(_since_start(seconds, player))
    if sign:
        return timeline.count_until(player.position + (seconds if sign == "+" else -seconds))
    return timeline.count_until(seconds)


def _seconds(text: str) -> float:
    total = 0.0
    for part in text.split(":"):
        total = 60 * total + float(part)
    return total


def _since_start(time_of_day: float, player: Player) -> float:
    """Return the seconds from the first event to the next time that the clock shows this (UTC)."""
    start = player.recording.timeline.start
    if start is None:
        return 0.0
    midnight = start.replace(hour=0, minute=0, second=0, microsecond=0)
    passed = (midnight + timedelta(seconds=time_of_day) - start).total_seconds()
    return passed if passed >= 0 else passed + timedelta(days=1).total_seconds()
