"""The folded session at some event, kept as JSON, so that a replay need not fold from the start.

A keyframe holds no picture, which the log has, and no mission, which are kept one by one.
"""

import zlib
from collections import deque
from collections.abc import Callable, Iterator, MutableMapping, Sequence
from dataclasses import dataclass, field
from functools import cache

from pydantic import TypeAdapter

from pa_console.schema.alarm import QueueEntry
from pa_console.schema.events import event as ev
from pa_console.session.state.fold import NOTICES_KEPT, Notice, OpenAlarm, SessionState, Stop
from pa_console.session.state.mission_trace import CommandTrace, MissionTrace
from pa_console.session.state.standing_trace import StandingTrace


@dataclass(frozen=True)
class Keyframe:
    """A SessionState without its picture and missions, of which it has the first `arrived`."""

    arrived: int
    started: ev.SessionStarted | None
    ended: str
    tick: int
    worker: ev.WorkerChanged | None
    active: str | None
    last_active: str | None
    latest: str | None
    queue: tuple[QueueEntry, ...]
    stop: Stop | None
    notices: list[Notice]
    open_alarms: dict[str, OpenAlarm]
    answers: dict[str, str]
    loose_orders: dict[str, CommandTrace]
    servers: dict[str, ev.ServerChanged] = field(default_factory=dict[str, ev.ServerChanged])
    standing: dict[str, StandingTrace] = field(default_factory=dict[str, StandingTrace])


@cache
def _keyframes() -> TypeAdapter[Keyframe]:
    """Return what reads and writes keyframes; made when a recording is, not when a console is."""
    return TypeAdapter(Keyframe)


@cache
def _missions() -> TypeAdapter[MissionTrace]:
    """Return what reads and writes missions."""
    return TypeAdapter(MissionTrace)


class MissionShelf(MutableMapping[str, MissionTrace]):
    """Missions by id, in the order of their arrival; each is loaded when it is first asked for."""

    def __init__(self, kept: Sequence[str], load: Callable[[str], MissionTrace]) -> None:
        """`load` brings one of those that are `kept`."""
        self._order = dict.fromkeys(kept)
        self._load = load
        self._here: dict[str, MissionTrace] = {}

    def __getitem__(self, name: str) -> MissionTrace:
        if name not in self._here:
            if name not in self._order:
                raise KeyError(name)
            self._here[name] = self._load(name)
        return self._here[name]

    def __setitem__(self, name: str, trace: MissionTrace) -> None:
        self._order.setdefault(name)
        self._here[name] = trace

    def __delitem__(self, name: str) -> None:
        del self._order[name]
        self._here.pop(name, None)

    def __contains__(self, name: object) -> bool:
        return name in self._order

    def __iter__(self) -> Iterator[str]:
        return iter(self._order)

    def __len__(self) -> int:
        return len(self._order)


def pack_state(state: SessionState) -> bytes:
    """Return `state` without its picture and missions."""
    frame = Keyframe(
        arrived=len(state.missions),
        started=state.started,
        ended=state.ended,
        tick=state.tick,
        worker=state.worker,
        servers=state.servers,
        standing=state.standing,
        active=state.active,
        last_active=state.last_active,
        latest=state.latest,
        queue=state.queue,
        stop=state.stop,
        notices=list(state.notices),
        open_alarms=state.open_alarms,
        answers=state.answers,
        loose_orders=state.loose_orders,
    )
    return zlib.compress(_keyframes().dump_json(frame), 1)


def unpack_state(
    packed: bytes, missions: Sequence[str], load: Callable[[str], MissionTrace]
) -> SessionState:
    """Return the state that was packed, without its picture; `missions` are all of the session."""
    frame = _keyframes().validate_json(zlib.decompress(packed))
    return SessionState(
        started=frame.started,
        ended=frame.ended,
        tick=frame.tick,
        worker=frame.worker,
        servers=frame.servers,
        standing=frame.standing,
        missions=MissionShelf(missions[: frame.arrived], load),
        active=frame.active,
        last_active=frame.last_active,
        latest=frame.latest,
        queue=frame.queue,
        stop=frame.stop,
        notices=deque(frame.notices, maxlen=NOTICES_KEPT),
        open_alarms=frame.open_alarms,
        answers=frame.answers,
        loose_orders=frame.loose_orders,
    )


def pack_mission(trace: MissionTrace) -> bytes:
    """Return everything known of one mission."""
    return zlib.compress(_missions().dump_json(trace), 1)


def unpack_mission(packed: bytes) -> MissionTrace:
    """Return the mission that was packed."""
    return _missions().validate_json(zlib.decompress(packed))
