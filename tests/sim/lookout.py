"""A small world with one gate, and scenes in it, for tests of sensors and tracks."""

import math
import random
from typing import Any

from pa_console.schema.base import Point
from pa_console.schema.incident import SpawnTrack
from pa_console.schema.world import AssetKind, World
from pa_console.sim import contacts, telemetry
from pa_console.sim.picture import marks_of
from pa_console.sim.scene import AssetState, Heard, Scene
from pa_console.sim.sensing_state import ContactState
from pa_console.sim.worlds.terrain import Terrain

RANGE_M = 50.0
_SENSOR = {"sensor_range_m": RANGE_M, "detection_probability": 1.0, "position_noise_m": 0.0}
_PLATFORM = {
    **_SENSOR,
    "speed_mps": 5.0,
    "turn_rate_dps": 90.0,
    "radius_m": 0.5,
    "drain_idle_pct_per_min": 0.0,
    "drain_moving_pct_per_min": 0.0,
}


def lookout(
    *,
    walls: tuple[tuple[Point, Point], ...] = (),
    sensor: dict[str, float] | None = None,
    cameras: dict[str, dict[str, Any]] | None = None,
    **fields: Any,
) -> World:
    """Return a world whose lane comes straight from the north to one gate, with exact sensors.

    `sensor` changes every sensor, `cameras` gives cameras by name.
    """
    sense = sensor or {}
    return World.model_validate(
        {
            "name": "lookout",
            "title": "One gate",
            "standoff_m": 10.0,
            "coverage_grace_s": 20.0,
            "perimeter": ((-60.0, -60.0), (60.0, -60.0), (60.0, 0.0), (-60.0, 0.0)),
            "walls": tuple({"start": start, "end": end} for start, end in walls),
            "frames": {
                "Gate": {"kind": "gate", "at": (0.0, -6.0)},
                "Post": {"kind": "post", "at": (0.0, -30.0)},
                "Home": {"kind": "base", "at": (40.0, -40.0)},
            },
            "lanes": {"Lane": {"gate": "Gate", "points": ((0.0, 300.0), (0.0, 6.0))}},
            "cameras": {
                name: {"gate": "Gate", "at": (8.0, 1.0), "heading_deg": 90.0, **_SENSOR, **spec}
                | sense
                for name, spec in (cameras or {}).items()
            },
            "platforms": dict.fromkeys(("uav", "ugv", "robot"), _PLATFORM | sense),
            "assets": {
                "Eagle": {"kind": "uav", "post": "Home"},
                "Mule": {"kind": "ugv", "post": "Home"},
                "Fox": {"kind": "robot", "post": "Home"},
            },
            **fields,
        }
    )


def scene_at(*assets: tuple[str, AssetKind, Point], seed: int = 0) -> Scene:
    """Return a scene with assets (name, kind, place) that stand there."""
    scene = Scene(rng=random.Random(seed))
    for index, (name, kind, at) in enumerate(assets):
        scene.assets[name] = AssetState(name, kind, index, *at, 0.0, 100.0, None, at)
    return scene


def reports_from(terrain: Terrain, scene: Scene, name: str, at: Point) -> None:
    """Let the station have heard now that an asset is at `at`; of a camera it knows the place."""
    spec = terrain.world.assets.get(name)
    if spec is not None:
        asset = AssetState(name, spec.kind, 0, *at, 0.0, 100.0, None, at)
        said = telemetry.report_of(terrain, scene.tick, asset)
        scene.station.heard[name] = Heard(said, scene.tick, marks_of("ok"))


def stand(terrain: Terrain, scene: Scene, at: Point, **truth: Any) -> ContactState:
    """Put a contact at a point, the lane's nearest one as soon as the scene is advanced."""
    truth.setdefault("distance_m", math.dist(at, terrain.world.frames["Gate"].at))
    contact = contacts.spawn(terrain, scene, SpawnTrack(gate="Gate", **truth))
    contact.x, contact.y = at
    return contact
