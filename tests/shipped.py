"""The shipped missions and worlds, read once for all files of tests."""

from functools import cache
from pathlib import Path
from typing import Any

import yaml

from pa_console.evaluation.jobs import load_with_worlds
from pa_console.resources import data_folder
from pa_console.schema.evaluation import MissionCase, MissionSet
from pa_console.schema.world import World
from pa_console.sim.worlds.world_file import load_world

CHECKPOINT = data_folder() / "worlds" / "checkpoint"


@cache
def home() -> World:
    """Return the world of the checkpoint."""
    return load_world(CHECKPOINT / "world.yaml")


@cache
def mission_sets() -> tuple[tuple[MissionSet, dict[str, World]], ...]:
    """Return the mission sets of the checkpoint, each with the worlds that it names."""
    files = sorted(CHECKPOINT.glob("missions/*.yaml"))
    return tuple(load_with_worlds(file, home()) for file in files)


@cache
def missions() -> dict[str, tuple[MissionCase, World]]:
    """Return every mission by its id, with its world."""
    return {
        case.id: (case, worlds[case.world])
        for found, worlds in mission_sets()
        for case in found.missions
    }


def quick_yaml(file: Path) -> Any:
    """Return what a YAML file says, ten times as fast as `yaml.safe_load`."""
    return yaml.load(file.read_text(encoding="utf-8"), Loader=yaml.CSafeLoader)
