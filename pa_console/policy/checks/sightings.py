"""The station's memory of sightings: place and time of each track, for checks.

It is made of pictures alone, so that a recorded session gives the same memory again. A place is a
zone in which the track's position lies, or a frame within whose radius it is, else ''.
"""

import math
from collections.abc import Iterable, Iterator
from functools import cached_property
from typing import Any, NamedTuple

from shapely import Point, Polygon

from pa_console.schema.telemetry import Identity, Intent, Picture, Track
from pa_console.schema.world import World

KEPT_S = 3600.0
"""The time that a sighting is remembered, simulated seconds."""

Values = dict[str, Any]


class Sighting(NamedTuple):
    """The last detection of a track at a place, in simulated seconds, and its known properties."""

    track: str
    place: str
    gate: str
    stamp_s: float
    kind: str = "vehicle"
    identity: Identity = "unknown"
    intent: Intent = "unknown"
    noncombatants: bool = False


class Sightings:
    """Remembers the last detection of each track at each place, for KEPT_S seconds.

    What is found out about a track later holds for where it was seen before: a vehicle that turns
    out to carry noncombatants carried them there too.
    """

    def __init__(self, world: World, past: Iterable[Sighting] = ()) -> None:
        """Begin with the sightings of the `past`, oldest first."""
        self._world = world
        self._posts = [name for name in world.frames if name not in world.gates]
        self._last = {(seen.track, seen.place): seen for seen in past}

    @cached_property
    def _zones(self) -> list[tuple[str, Polygon]]:
        return [(name, Polygon(zone.polygon)) for name, zone in self._world.zones.items()]

    def look(self, picture: Picture) -> None:
        """Take in what `picture` shows: detections that are new, and new facts about tracks."""
        for track in picture.tracks.values():
            for place in self._places(track):
                key = (track.id, place)
                known = self._last.get(key)
                if known is None or known.stamp_s < track.stamp_s:
                    self._last.pop(key, None)  # the latest come last
                    self._last[key] = _sighting(track, place, track.stamp_s)
        for key, seen in self._last.items():
            if (track := picture.tracks.get(seen.track)) is not None:
                self._last[key] = _sighting(track, seen.place, seen.stamp_s)
        old = [key for key, seen in self._last.items() if picture.time_s - seen.stamp_s > KEPT_S]
        for key in old:
            del self._last[key]

    def at(self, picture: Picture) -> list[Values]:
        """Return the `sightings` that checks see when `picture` is the present, as plain values.

        `picture` counts as seen; nothing is remembered of it.
        """
        now = Sightings(self._world, self._last.values())
        now.look(picture)
        return [
            seen._asdict() | {"age_s": picture.time_s - seen.stamp_s} for seen in now._last.values()
        ]

    def copy(self) -> "Sightings":
        """Return a copy that stays as it is when this goes on."""
        return Sightings(self._world, self._last.values())

    def _places(self, track: Track) -> Iterator[str]:
        """Yield where the track is: zones, its gate and frames that are no gates."""
        found = [name for name, area in self._zones if area.covers(Point(track.position))]
        for name in (track.gate, *self._posts):
            frame = self._world.frames.get(name)
            if frame is not None and math.dist(frame.at, track.position) <= frame.radius_m:
                found.append(name)
        yield from found or [""]


def _sighting(track: Track, place: str, stamp_s: float) -> Sighting:
    return Sighting(
        track=track.id,
        place=place,
        gate=track.gate,
        stamp_s=stamp_s,
        kind=track.kind,
        identity=track.identity,
        intent=track.intent,
        noncombatants=track.noncombatants,
    )
