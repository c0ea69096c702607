"""Random worlds to train in: the shipped layout and generated ones, with names from word banks."""

import hashlib
import random
from collections.abc import Collection, Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Literal

from pa_console.evaluation.jobs import load_missions
from pa_console.resources import data_folder
from pa_console.schema.base import StrictModel
from pa_console.schema.document import Document
from pa_console.schema.evaluation import GeneratedWorld
from pa_console.schema.world import AssetKind, AssetSpec, World
from pa_console.sim.worlds.world_file import load_world
from pa_console.sim.worlds.world_generator import generate_world
from pa_training import LANGUAGE

Split = Literal["train", "heldout"]
"""Worlds to train on, or worlds whose names no training world uses."""

HELD_OUT = 0.2
"""About this part of a bank's words is held out."""

_GATE_FORMS = (("{word}Gate", 86), ("{word}_Gate", 4), ("{word}Entrance", 4), ("Gate{word}", 2))
_NUMBERED_GATES = (("Gate_{number}", 2), ("Gate{letter}", 2))
_ASSET_FORMS = (
    ("{word}_T{number:02d}", 80),
    ("{word}_{number}", 6),
    ("{word}{number}", 6),
    ("{word}_{number:02d}", 4),
    ("{word}_{letter}", 4),
)
_LETTERS = "ABCDEFGHIJKLMNOP"
_KINDS: tuple[AssetKind, ...] = ("uav", "ugv", "robot")


class _Always(StrictModel):
    """Words of each bank that are never held out."""

    gates: str
    posts: str
    bases: str
    zones: str
    uav: str
    ugv: str
    robot: str


class _Words(StrictModel):
    """The file of word banks: the words of each, with spaces between them."""

    gates: str
    posts: str
    bases: str
    zones: str
    teams: dict[AssetKind, str]
    always: _Always


def bank(name: str, split: Split) -> tuple[str, ...]:
    """Return the words of the bank gates, posts, bases, zones, uav, ugv or robot for `split`.

    Raises KeyError for another name and DocumentError when the file of banks is broken.
    """
    return tuple(word for word in words(name) if (word in held_out(name)) == (split == "heldout"))


@cache
def held_out(name: str) -> frozenset[str]:
    """Return the words of a bank that no training world uses; a word is held out by its hash."""
    always = {word for text in _banks().always.model_dump().values() for word in text.split()}
    return frozenset(word for word in words(name) if word not in always and _drawn(word))


def words(name: str) -> tuple[str, ...]:
    """Return every word of a bank; raises KeyError for an unknown one."""
    banks = _banks()
    every = {
        "gates": banks.gates,
        "posts": banks.posts,
        "bases": banks.bases,
        "zones": banks.zones,
        **banks.teams,
    }
    return tuple(dict.fromkeys(every[name].split()))


def frame_names(rng: random.Random, world: World, split: Split) -> dict[str, str]:
    """Return a new name for every frame of `world`, all different whatever their case."""
    posts = [name for name, frame in world.frames.items() if frame.kind == "post"]
    gates = _gates(rng, len(world.gates), split)
    taken = {gate.lower() for gate in gates}
    base = _one(rng, "bases", split, taken)
    named = {**dict(zip(world.gates, gates, strict=True)), world.base: base}
    return named | {post: _one(rng, "posts", split, taken) for post in posts}


def zone_names(
    rng: random.Random, world: World, split: Split, frames: Mapping[str, str]
) -> dict[str, str]:
    """Return a new name for every zone of `world`, none of them one of the new `frames`."""
    taken = {name.lower() for name in frames.values()}
    return {zone: _one(rng, "zones", split, taken) for zone in world.zones}


def asset_names(rng: random.Random, world: World, split: Split) -> dict[str, str]:
    """Return a new name for every asset of `world`: a word for each kind, and its number."""
    form = _weighted(rng, _ASSET_FORMS)
    prefixes = {kind: rng.choice(bank(kind, split)) for kind in _KINDS}
    numbers = dict.fromkeys(_KINDS, 0)
    named: dict[str, str] = {}
    for asset, spec in world.assets.items():
        number = numbers[spec.kind] = numbers[spec.kind] + 1
        letter = _LETTERS[(number - 1) % len(_LETTERS)]
        named[asset] = form.format(word=prefixes[spec.kind], number=number, letter=letter)
    return named if len({*named.values()}) == len(named) else asset_names(rng, world, split)


def _gates(rng: random.Random, count: int, split: Split) -> list[str]:
    """Return names of gates in one form; numbers and letters tell no split from the other."""
    forms = _GATE_FORMS if split == "heldout" else (*_GATE_FORMS, *_NUMBERED_GATES)
    form = _weighted(rng, forms)
    chosen = rng.sample(bank("gates", split), count)
    return [
        form.format(word=word, number=index + 1, letter=_LETTERS[index % len(_LETTERS)])
        for index, word in enumerate(chosen)
    ]


def _one(rng: random.Random, name: str, split: Split, taken: set[str]) -> str:
    """Return a word of the bank that is not `taken` yet, and note that it is now."""
    word = rng.choice([word for word in bank(name, split) if word.lower() not in taken])
    taken.add(word.lower())
    return word


def _weighted(rng: random.Random, forms: tuple[tuple[str, int], ...]) -> str:
    return rng.choices([form for form, _ in forms], [weight for _, weight in forms])[0]


def _drawn(word: str) -> bool:
    digest = hashlib.sha256(f"name/{word}".encode()).digest()
    return int.from_bytes(digest[:4], "big") / 2**32 < HELD_OUT


@cache
def _banks() -> _Words:
    return Document.read(LANGUAGE / "names.yaml").parse(_Words)


Numbers = tuple[int, int, int]
"""What makes a generated world: gates, assets, seed."""

LEAST_GATES, MOST_GATES = 2, 8
LEAST_ASSETS, MOST_ASSETS = 4, 16
OWN_NAMES, OWN_LAYOUT = 0.35, 0.5
"""Up to the first, worlds are the shipped one; up to the second, it has other names."""
_SEEDS = 1_000_000


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
    """Return `world` with every frame, asset and zone named anew, lanes and cameras to fit.

    What people there call them is left out.
    """
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
            "aliases": {},
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
