"""Limits on the contacts of one sensor: none beyond its range, and no more than its share.

A sensor that errs or lies can report contacts without end. Each would become a track, an alarm and
a mission, and hide the contacts that are there. With a share for each sensor, the contacts of the
others always become tracks.
"""

import math
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from pa_console.schema.base import Point
from pa_console.schema.text import count
from pa_console.schema.world import World
from pa_console.sim.integrity import NOISE_M, SPEED_MARGIN
from pa_console.sim.scene import Heard
from pa_console.sim.sensing_state import Detection, TrackFile

MOST_CONTACTS = 64
"""Most contacts of one message that are taken in; a busy gate has about ten."""

MOST_ALONE = 32
"""Most tracks that rest on one sensor alone: more than a crowd at a gate."""

MOST_TRACKS = 128
"""Most tracks in all: rules, rehearsal and map take in each of them at every picture. Three sensors
that lie do not fill them. In a full picture, a contact of a sensor that reports few takes the place
of one of a sensor that reports many."""

SIGMAS = 5.0
"""A measurement is off by more than so much of its sensor's noise once in 200,000 times."""


class SetAside(NamedTuple):
    """Contacts of `sensor` that were not taken in: the reason follows its name in `text`."""

    sensor: str
    text: str
    kind: str


class Reach(NamedTuple):
    """The place of a sensor and its range; with its noise and movement, `doubt_m` more."""

    at: Point
    range_m: float
    doubt_m: float

    @classmethod
    def of_camera(cls, world: World, name: str) -> "Reach":
        """Return the reach of a fixed camera."""
        camera = world.cameras[name]
        return cls(camera.at, camera.sensor_range_m, SIGMAS * camera.position_noise_m)

    @classmethod
    def of_asset(cls, world: World, name: str, heard: Heard, stamp: int) -> "Reach":
        """Return the reach of an asset at tick `stamp`, from where it reported itself last."""
        platform = world.platforms[world.assets[name].kind]
        elapsed_s = abs(stamp - heard.stamp) * world.dt_s
        moved_m = SPEED_MARGIN * platform.speed_mps * elapsed_s + NOISE_M
        doubt_m = moved_m + SIGMAS * platform.position_noise_m
        return cls(heard.telemetry.like.position, platform.sensor_range_m, doubt_m)

    def covers(self, at: Point) -> bool:
        """Return whether a thing that was measured `at` a place may be in view."""
        return math.dist(self.at, at) <= self.range_m + self.doubt_m


def beyond(sensor: str, reach: Reach, number: int) -> SetAside:
    """Return that `number` detections are of places beyond the reach of the sensor."""
    text = (
        f"reports {count(number, 'detection')} from beyond its range of {reach.range_m:.0f} m: "
        "set aside"
    )
    return SetAside(sensor, text, "beyond range")


def without_place(sensor: str) -> SetAside:
    """Return that a sensor has not reported the place that its contacts are seen from."""
    return SetAside(sensor, "reports contacts but not where it is: set aside", "no place")


def within_share(
    files: dict[str, TrackFile], sensor: str, found: Sequence[Detection]
) -> tuple[list[Detection], list[SetAside]]:
    """Return the detections that are taken in, and notes on those of any sensor that are not.

    Contacts that have tracks come first. If all tracks are taken, a track of a sensor that reports
    more is removed from `files` for a new contact.
    """
    ordered = sorted(found, key=lambda detection: detection.contact not in files)
    own = frozenset((sensor,))
    alone = sum(_sensors(file) == own for file in files.values())
    taken: list[Detection] = []
    new: set[str] = set()
    gave_way: Counter[str] = Counter()
    room = MOST_ALONE - alone
    for detection in ordered[:MOST_CONTACTS]:
        known = detection.contact in files or detection.contact in new
        if not known and detection.position is not None:
            if len(new) >= room:
                continue
            if len(files) + len(new) >= MOST_TRACKS:
                other = _make_room(files, sensor, alone + len(new))
                if other is None:  # nor will there be room for the rest
                    room = 0
                    continue
                gave_way[other] += 1
            new.add(detection.contact)
        taken.append(detection)
    aside = [
        SetAside(other, f"reports so much that {count(number, 'track')} of it gave way", "gave way")
        for other, number in gave_way.items()
    ]
    if len(taken) < len(found):
        text = f"reports {len(found)} contacts: {len(taken)} are taken, the rest is set aside"
        aside.append(SetAside(sensor, text, "many contacts"))
    return taken, aside


def _make_room(files: dict[str, TrackFile], sensor: str, alone: int) -> str | None:
    """Remove the newest track of the sensors that report most; return one of them.

    All sensors that detect it report more contacts than `sensor`, which has `alone` for itself.
    None is returned where there is no such track.
    """
    load = Counter(name for file in files.values() for name in _sensors(file))
    least = {
        contact: min((load[name] for name in _sensors(file)), default=0)
        for contact, file in files.items()
    }
    newest = max(files, key=lambda contact: (least[contact], files[contact].first_tick))
    if least[newest] <= max(load[sensor], alone) + 1:
        return None
    return min(_sensors(files.pop(newest)), key=lambda name: (load[name], name))


def _sensors(file: TrackFile) -> frozenset[str]:
    """Return the sensors that have detected the contact of a track."""
    return frozenset(sighting.sensor for sighting in file.seen)
