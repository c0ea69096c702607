"""Random worlds to train in: the shipped layout and generated ones, with names from the banks."""

import random
from collections.abc import Collection, Iterable, Mapping
from functools import cache
from pathlib import Path

from pa_console.evaluation.mission_set import load_missions
from pa_console.resources import data_folder
from pa_console.schema.mission_set import GeneratedWorld
from pa_console.schema.world import AssetKind, AssetSpec, World
from pa_console.sim.world_file import load_world
from pa_console.sim.world_generator import generate_world
from pa_console.training.names import Split, asset_names, frame_names, zone_names

Numbers = tuple[int, int, int]
"""What makes a generated world: gates, assets, seed."""

LEAST_GATES, MOST_GATES = 2, 8
LEAST_ASSETS, MOST_ASSETS = 4, 16
OWN_NAMES, OWN_LAYOUT = 0.35, 0.5
"""Up to the first, worlds are the shipped one; up to the second, it has other names."""
_SEEDS = 1_000_000
_KINDS: tuple[AssetKind, ...] = ("uav", "ugv", "robot")


def random_world(
    rng: random.Random, split: Split = "train", forbidden: Collection[Numbers] = ()
) -> World:
    """Return a world for `split`; equal states of `rng` give equal worlds.

    A held-out world has no name and no ground that a training world has. Worlds that the generator
    makes of `forbidden` numbers are never used, whatever they would be called.
    """
    drawn = rng.random()
    if split == "train" and drawn < OWN_NAMES:
        return shipped_world()
    if split == "train" and drawn < OWN_LAYOUT:
        home = shipped_world()
        return renamed(rng, _other_team(rng, home) if rng.random() < 0.6 else home, split)
    while True:
        numbers = _numbers(rng, split)
        if numbers not in forbidden:
            return renamed(rng, generate_world(*numbers), split)


def renamed(rng: random.Random, world: World, split: Split) -> World:
    """Return `world` with every frame, asset and zone named anew, and lanes and cameras to fit."""
    frames = frame_names(rng, world, split)
    assets = asset_names(rng, world, split)
    zones = zone_names(rng, world, split, frames)
    return world.model_copy(
        update={
            "frames": {frames[name]: frame for name, frame in world.frames.items()},
            "lanes": {
                f"{frames[lane.gate]}_lane{number}": lane.model_copy(
                    update={"gate": frames[lane.gate]}
                )
                for number, lane in enumerate(world.lanes.values(), start=1)
            },
            "cameras": {
                f"{frames[camera.gate]}_camera{number}": camera.model_copy(
                    update={"gate": frames[camera.gate]}
                )
                for number, camera in enumerate(world.cameras.values(), start=1)
            },
            "zones": {zones[name]: zone for name, zone in world.zones.items()},
            "assets": _sorted_team(
                {
                    assets[name]: spec.model_copy(update={"post": frames[spec.post]})
                    for name, spec in world.assets.items()
                }
            ),
        }
    )


def generated_numbers(files: Iterable[Path]) -> frozenset[Numbers]:
    """Return what makes the generated worlds of the mission sets in `files`.

    Training in them would be training on the test. Raises DocumentError for a broken file.
    """
    home = shipped_world()
    return frozenset(
        (made.gates, made.assets, made.seed)
        for file in files
        for made in load_missions(file, home).worlds.values()
        if isinstance(made, GeneratedWorld)
    )


def shipped_missions() -> tuple[Path, ...]:
    """Return the mission sets that come with the console's own world."""
    return tuple(sorted(_folder().glob("missions/*.yaml")))


@cache
def shipped_world() -> World:
    """Return the console's own world."""
    return load_world(_folder() / "world.yaml")


def _folder() -> Path:
    return data_folder() / "worlds" / "checkpoint"


def _numbers(rng: random.Random, split: Split) -> Numbers:
    """Draw how large a world is, mostly with an asset for every gate and some to spare."""
    gates = rng.randint(LEAST_GATES, MOST_GATES)
    least = LEAST_ASSETS if rng.random() < 0.1 else max(LEAST_ASSETS, gates + 1)
    assets = min(MOST_ASSETS, rng.randint(least, max(least, gates + 7)))
    first = 0 if split == "train" else _SEEDS
    return gates, assets, rng.randrange(first, first + _SEEDS)


def _other_team(rng: random.Random, world: World) -> World:
    """Return `world` with another team: everybody elsewhere, a guard at every gate."""
    posts = [name for name, frame in world.frames.items() if frame.kind != "gate"]
    where = [*world.gates, *rng.choices(posts, k=rng.randint(2, 6))]
    where += rng.sample(world.gates, rng.randint(0, 2))
    kinds: list[AssetKind] = [
        *_KINDS,
        *rng.choices(_KINDS, weights=(4, 3, 3), k=len(where) - len(_KINDS)),
    ]
    rng.shuffle(kinds)
    team = {
        f"{kind}{number}": AssetSpec(kind=kind, post=post)
        for number, (kind, post) in enumerate(zip(kinds, where, strict=True))
    }
    return world.model_copy(update={"assets": team})


def _sorted_team(assets: Mapping[str, AssetSpec]) -> dict[str, AssetSpec]:
    """Return the team kind after kind, as world files list it."""
    return dict(sorted(assets.items(), key=lambda item: _KINDS.index(item[1].kind)))
