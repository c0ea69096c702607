"""Writes a replay as an asciicast, version 2, which every asciinema since 2.0 plays."""

import json
from collections.abc import Callable, Iterator
from datetime import datetime
from typing import BinaryIO

from pa_console.export.film import Film, Size
from pa_console.schema.event import MissionReceived
from pa_console.schema.visible import visible_json, visible_line
from pa_console.session.recording import Recording

BEGIN = "\x1b[?25l\x1b[0m\x1b[2J"
END = "\x1b[0m\x1b[?25h\r\n"


def positions(recording: Recording, first: float, last: float, step: float) -> list[float]:
    """Return the seconds to be shown, `step` apart, leaving out those at which nothing is new."""
    shown = [first]
    known = recording.count_until(first)
    for number in range(1, int((last - first) / step) + 1):
        at = first + number * step
        count = recording.count_until(at)
        if count > known:
            shown.append(at)
            known = count
    if recording.count_until(last) > known:
        shown.append(last)
    return shown


class CastWriter:
    """Shoots the positions of a replay and writes what the terminal was sent at each."""

    def __init__(
        self, target: BinaryIO, size: Size, speed: float, advance: Callable[[int], None]
    ) -> None:
        """`speed` is recorded seconds a second; `advance` is told of every shot."""
        self._target, self._size = target, size
        self._speed, self._advance = speed, advance

    def begin(self, start: datetime, title: str) -> None:
        """Write the header; `start` is when the session was recorded."""
        width, height = self._size
        header = {
            "version": 2,
            "width": width,
            "height": height,
            "timestamp": int(start.timestamp()),
            "title": visible_line(title),
            "env": {"TERM": "xterm-256color"},
        }
        self._write(header)

    async def shoot(self, film: Film, shown: list[float]) -> None:
        """Write a frame for each of the positions, and a marker for each mission that arrives."""
        film.player.rate = self._speed
        done = film.player.recording.count_until(shown[0])
        film.player.seek(shown[0])
        film.player.playing = True
        await film.show()
        self._write((0.0, "o", BEGIN + film.written()))
        self._advance(1)
        for position in shown[1:]:
            film.player.seek(position)
            film.player.playing = True
            await film.show()
            when = round((position - shown[0]) / self._speed, 3)
            for text in _arrivals(film.player.recording, range(done, film.player.index)):
                self._write((when, "m", text))
            done = film.player.index
            self._write((when, "o", film.written()))
            self._advance(1)
        self._write((round((shown[-1] - shown[0]) / self._speed + 2.0, 3), "o", END))

    def _write(self, line: object) -> None:
        self._target.write(visible_json(json.dumps(line, ensure_ascii=False)).encode() + b"\n")


def _arrivals(recording: Recording, span: range) -> Iterator[str]:
    """Yield id and text of every mission that arrives with the events of `span`."""
    for index in span:
        if recording.of_mission(index):
            data = recording[index].data
            if isinstance(data, MissionReceived):
                yield visible_line(f"{data.mission.id} {data.mission.text}")
