"""The folded session at some event, kept as JSON, so that a replay need not fold from the start.

A keyframe holds no picture, which the log has, and no mission, which are kept one by one.
"""

import zlib
from collections import deque
from collections.abc import Callable, Iterator, MutableMapping, Sequence
from dataclasses import replace
from functools import cache

from pydantic import TypeAdapter

from pa_console.session.state.fold import NOTICES_KEPT, SessionState
from pa_console.session.state.mission_trace import MissionTrace


@cache
def _keyframes() -> TypeAdapter[tuple[int, SessionState]]:
    """Return what reads and writes keyframes; made when a recording is, not when a console is.

    A keyframe is how many missions had arrived, and the session without them and its picture.
    """
    return TypeAdapter(tuple[int, SessionState])


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
    frame = len(state.missions), replace(state, picture=None, missions={})
    return zlib.compress(_keyframes().dump_json(frame), 1)


def unpack_state(
    packed: bytes, missions: Sequence[str], load: Callable[[str], MissionTrace]
) -> SessionState:
    """Return the state that was packed, without its picture; `missions` are all of the session."""
    arrived, state = _keyframes().validate_json(zlib.decompress(packed))
    state.missions = MissionShelf(missions[:arrived], load)
    state.notices = deque(state.notices, maxlen=NOTICES_KEPT)
    return state


def pack_mission(trace: MissionTrace) -> bytes:
    """Return everything known of one mission."""
    return zlib.compress(_missions().dump_json(trace), 1)


def unpack_mission(packed: bytes) -> MissionTrace:
    """Return the mission that was packed."""
    return _missions().validate_json(zlib.decompress(packed))
