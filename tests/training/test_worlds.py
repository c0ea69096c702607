"""Random worlds: reproducible, valid, never a test's own, and held-out ones wholly new."""

import random
import re

from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.schema.world import World
from pa_training.situations.worlds import (
    Split,
    generated_numbers,
    held_out,
    random_world,
    shipped_missions,
    shipped_world,
)

SEEDS = st.integers(0, 10**6)
KEPT = {
    word
    for name in ("gates", "posts", "bases", "zones", "uav", "ugv", "robot")
    for word in held_out(name)
}


def world_of(seed: int, split: Split = "train") -> World:
    return random_world(random.Random(seed), split)


def said(world: World) -> set[str]:
    """Return the words that the names of `world` are made of."""
    names = [*world.frames, *world.zones, *world.assets]
    bare = [re.sub(r"Gate|Entrance|_T?\w{1,2}$|\d+$", "", name) for name in names]
    return {word.strip("_") for word in bare if word}


@settings(max_examples=20, deadline=None)
@given(SEEDS, st.sampled_from(("train", "heldout")))
def test_equal_seeds_give_equal_and_valid_worlds(seed: int, split: Split) -> None:
    world = world_of(seed, split)
    assert world == world_of(seed, split)
    assert World.model_validate(world.model_dump()) == world
    assert 2 <= len(world.gates) <= 8
    assert 4 <= len(world.assets) <= 16


@settings(max_examples=30, deadline=None)
@given(SEEDS)
def test_held_out_words_are_in_held_out_worlds_only(seed: int) -> None:
    assert not said(world_of(seed)) & KEPT
    assert said(world_of(seed, "heldout")) <= KEPT


def test_a_third_of_the_training_worlds_are_the_shipped_one() -> None:
    worlds = [world_of(seed) for seed in range(120)]
    own = sum(world == shipped_world() for world in worlds)
    layout = sum(world.perimeter == shipped_world().perimeter for world in worlds)
    assert 25 <= own <= 60
    assert own < layout <= 80


@settings(max_examples=15, deadline=None)
@given(SEEDS)
def test_forbidden_worlds_are_never_made_under_any_name(seed: int) -> None:
    numbers = re.fullmatch(r"generated_g(\d+)_a(\d+)_s(\d+)", world_of(seed).name)
    if numbers is not None:
        gates, assets, made = map(int, numbers.groups())
        other = random_world(random.Random(seed), "train", {(gates, assets, made)})
        assert other.perimeter != world_of(seed).perimeter


def test_the_worlds_of_shipped_missions_are_known() -> None:
    assert all(len(numbers) == 3 for numbers in generated_numbers(shipped_missions()))
    assert generated_numbers(shipped_missions())
