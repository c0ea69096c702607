"""Writes a replay as numbered SVG pictures: one for chosen events, or one every so often."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

from pa_console.export.film import Film
from pa_console.schema.event import EventPayload
from pa_console.schema.event_base import Payload
from pa_console.session.recording import Recording
from pa_console.tui.words import clock_text

JUST_BEFORE_S = 5e-7
"""Half of the microsecond that time stamps are exact to."""

KINDS = tuple(
    sorted(
        payload.model_fields["kind"].default
        for payload in get_args(get_args(EventPayload)[0])
        if issubclass(payload, Payload) and not payload.transient
    )
)
"""The kinds of events that a log tells of."""


@dataclass(frozen=True)
class Shot:
    """When a picture is taken, why, and after which event, None for all up to `seconds`."""

    seconds: float
    name: str
    index: int | None = None


def shots_at(recording: Recording, kinds: Iterable[str], first: float, last: float) -> list[Shot]:
    """Return a shot after every event of one of `kinds`, of which telemetry is none."""
    wanted = frozenset(kinds)
    span = range(recording.count_until(first - JUST_BEFORE_S), recording.count_until(last))
    told = (index for index in span if not recording.is_telemetry(index))
    found = [(index, recording[index].data.kind) for index in told]
    return [Shot(recording.offset(index), kind, index) for index, kind in found if kind in wanted]


def shots_every(step: float, first: float, last: float) -> list[Shot]:
    """Return a shot every `step` seconds, beginning with `first`."""
    count = int((last - first) / step) + 1
    return [Shot(first + n * step, f"{first + n * step:.0f}s") for n in range(count)]


async def take(
    film: Film, shots: list[Shot], folder: Path, session: str, advance: Callable[[int], None]
) -> None:
    """Write `folder`/0001-NAME.svg and so on; `shots` are in the order of time."""
    digits = max(4, len(str(len(shots))))
    for number, shot in enumerate(shots, start=1):
        if shot.index is None:
            film.player.seek(shot.seconds)
        else:
            film.player.seek(shot.seconds - JUST_BEFORE_S)
            while film.player.index <= shot.index:
                film.player.step()
        await film.show()
        picture = film.svg(f"{session}  {shot.name}  {clock_text(shot.seconds)}")
        path = folder / f"{number:0{digits}}-{shot.name}.svg"
        path.write_text(picture, encoding="utf-8")
        advance(1)
