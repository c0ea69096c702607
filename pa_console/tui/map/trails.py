"""The recent places of assets and tracks, in the pictures that were shown."""

from collections import deque
from collections.abc import Iterator
from math import dist

from pa_console.schema.base import Point
from pa_console.schema.telemetry import Picture

TRAIL_S = 20.0
"""The length of a trail, simulated seconds."""

GAP_S = 6.0
"""The gap between two pictures after which the way is unknown, seconds."""

STEP_M = 0.5
"""Less than this is noise of a position."""

MOST_THINGS = 200
"""A larger team gets no trails: they would cover the map."""


class Trails:
    """Remembers the last positions of everything that moves."""

    def __init__(self) -> None:
        self._seen: dict[str, deque[tuple[float, Point]]] = {}
        self._time_s = 0.0

    def add(self, picture: Picture | None) -> None:
        """Take in another picture; one from before, or from much later, starts anew."""
        time_s = picture.time_s if picture is not None else 0.0
        if not self._time_s <= time_s <= self._time_s + GAP_S:
            self._seen.clear()
        self._time_s = time_s
        if picture is None or len(picture.assets) > MOST_THINGS:
            return
        things = {**picture.assets, **picture.tracks}
        for name in self._seen.keys() - things.keys():
            del self._seen[name]
        for name, thing in things.items():
            seen = self._seen.setdefault(name, deque())
            if not seen or dist(seen[-1][1], thing.position) >= STEP_M:
                seen.append((time_s, thing.position))
            while len(seen) > 1 and seen[1][0] < time_s - TRAIL_S:
                seen.popleft()

    def __iter__(self) -> Iterator[list[Point]]:
        """Yield the way of everything that has moved, oldest position first."""
        yield from ([point for _, point in seen] for seen in self._seen.values() if len(seen) > 1)
