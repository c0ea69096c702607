"""The default checkpoint, and helpers that run a simulation until something has ended."""

from pathlib import Path

import pytest

from pa_console.resources import find_data
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.worlds.world_file import load_world


@pytest.fixture(scope="session")
def world_path() -> Path:
    return find_data("worlds", "checkpoint", "world.yaml")


@pytest.fixture(scope="session")
def world(world_path: Path) -> World:
    return load_world(world_path)


@pytest.fixture
def sim(world: World) -> Checkpoint:
    return Checkpoint(world, seed=1)


@pytest.fixture(scope="session")
def crossing() -> World:
    """Two UGVs on either side of a passage too narrow for both."""
    platform = {
        "speed_mps": 4.0,
        "turn_rate_dps": 90.0,
        "radius_m": 1.2,
        "sensor_range_m": 30.0,
        "drain_idle_pct_per_min": 0.2,
        "drain_moving_pct_per_min": 1.0,
    }
    sides = [
        {"start": (x, side * 3.0), "end": (x, side * 20.0)} for x in (-4.0, 4.0) for side in (1, -1)
    ]
    roof = [{"start": (-4.0, side * 2.7), "end": (4.0, side * 2.7)} for side in (1, -1)]
    return World.model_validate(
        {
            "name": "crossing",
            "title": "Two vehicles, one passage",
            "standoff_m": 10.0,
            "coverage_grace_s": 20.0,
            "perimeter": ((-40.0, -20.0), (40.0, -20.0), (40.0, 20.0), (-40.0, 20.0)),
            "walls": (*sides, *roof),
            "frames": {
                "West": {"kind": "gate", "at": (-25.0, 0.0)},
                "East": {"kind": "base", "at": (25.0, 0.0)},
            },
            "platforms": {"ugv": platform},
            "assets": {
                "Right": {"kind": "ugv", "post": "West"},
                "Left": {"kind": "ugv", "post": "East"},
            },
        }
    )
