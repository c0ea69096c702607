"""A replay as numbered SVG pictures or as an asciicast, version 2."""

import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import BinaryIO, get_args

from pa_console.export.replayed_screen import ReplayedScreen, Size
from pa_console.schema.base import Payload
from pa_console.schema.events.event import EventPayload, MissionReceived
from pa_console.schema.text import clock_text, visible_json, visible_line
from pa_console.session.recording import Recording

JUST_BEFORE_S = 5e-7
"""Half of the resolution of time stamps, a microsecond."""

KINDS = tuple(
    sorted(
        payload.model_fields["kind"].default
        for payload in get_args(get_args(EventPayload)[0])
        if issubclass(payload, Payload) and not payload.transient
    )
)
"""The kinds of events in a log."""


@dataclass(frozen=True)
class Shot:
    """The time of a picture and its reason; it is taken after event `index`, if that is given."""

    seconds: float
    name: str
    index: int | None = None


def shots_at(recording: Recording, kinds: Iterable[str], first: float, last: float) -> list[Shot]:
    """Return a shot after every event of one of `kinds`; telemetry is left out."""
    wanted = frozenset(kinds)
    span = range(recording.count_until(first - JUST_BEFORE_S), recording.count_until(last))
    others = (index for index in span if not recording.is_telemetry(index))
    found = [(index, recording[index].data.kind) for index in others]
    return [Shot(recording.offset(index), kind, index) for index, kind in found if kind in wanted]


def shots_every(step: float, first: float, last: float) -> list[Shot]:
    """Return a shot every `step` seconds, beginning with `first`."""
    count = int((last - first) / step) + 1
    return [Shot(first + n * step, f"{first + n * step:.0f}s") for n in range(count)]


async def take(
    screen: ReplayedScreen,
    shots: list[Shot],
    folder: Path,
    session: str,
    advance: Callable[[int], None],
) -> None:
    """Write the files 0001-NAME.svg and so on to `folder`; `shots` are in the order of time."""
    digits = max(4, len(str(len(shots))))
    for number, shot in enumerate(shots, start=1):
        if shot.index is None:
            screen.player.seek(shot.seconds)
        else:
            screen.player.seek(shot.seconds - JUST_BEFORE_S)
            while screen.player.index <= shot.index:
                screen.player.step()
        await screen.show()
        picture = screen.svg(f"{session}  {shot.name}  {clock_text(shot.seconds)}")
        path = folder / f"{number:0{digits}}-{shot.name}.svg"
        path.write_text(picture, encoding="utf-8")
        advance(1)


BEGIN = "\x1b[?25l\x1b[0m\x1b[2J"
END = "\x1b[0m\x1b[?25h\r\n"


def positions(recording: Recording, first: float, last: float, step: float) -> list[float]:
    """Return seconds to show, `step` apart, without those at which there is no new event."""
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
    """A cast file: the terminal output at each position of a replay."""

    def __init__(
        self, target: BinaryIO, size: Size, speed: float, advance: Callable[[int], None]
    ) -> None:
        """`speed` is recorded seconds in a second; `advance` is called after every shot."""
        self._target, self._size = target, size
        self._speed, self._advance = speed, advance

    def begin(self, start: datetime, title: str) -> None:
        """Write the header; `start` is the time of the recording."""
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

    async def shoot(self, screen: ReplayedScreen, shown: list[float]) -> None:
        """Write a frame for each of the positions, and a marker for each mission that arrives."""
        screen.player.rate = self._speed
        done = screen.player.recording.count_until(shown[0])
        screen.player.seek(shown[0])
        screen.player.playing = True
        await screen.show()
        self._write((0.0, "o", BEGIN + screen.written()))
        self._advance(1)
        for position in shown[1:]:
            screen.player.seek(position)
            screen.player.playing = True
            await screen.show()
            when = round((position - shown[0]) / self._speed, 3)
            for text in _arrivals(screen.player.recording, range(done, screen.player.index)):
                self._write((when, "m", text))
            done = screen.player.index
            self._write((when, "o", screen.written()))
            self._advance(1)
        self._write((round((shown[-1] - shown[0]) / self._speed + 2.0, 3), "o", END))

    def _write(self, line: object) -> None:
        self._target.write(visible_json(json.dumps(line, ensure_ascii=False)).encode() + b"\n")


def _arrivals(recording: Recording, span: range) -> Iterator[str]:
    """Yield id and text of every mission that arrives in the events of `span`."""
    for index in span:
        if recording.of_mission(index):
            data = recording[index].data
            if isinstance(data, MissionReceived):
                yield visible_line(f"{data.mission.id} {data.mission.said}")
