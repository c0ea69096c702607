"""The word banks: large enough, and a part of each kept for worlds that no training sees."""

import pytest

from pa_console.resources import data_folder
from pa_console.sim.worlds.world_file import load_world
from pa_console.sim.worlds.world_generator import generate_world
from pa_training.situations.worlds import bank, held_out, words

BANKS = ("gates", "posts", "bases", "zones", "uav", "ugv", "robot")
EVERY = {word for name in BANKS for word in words(name)}


def test_gates_can_be_called_after_many_things() -> None:
    assert len(words("gates")) >= 200


@pytest.mark.parametrize("name", BANKS)
def test_every_bank_is_wide_and_keeps_a_part_back(name: str) -> None:
    assert len(words(name)) >= 30
    assert 3 <= len(bank(name, "heldout")) <= 0.4 * len(words(name))
    assert not set(bank(name, "heldout")) & set(bank(name, "train"))


def test_a_word_held_out_of_one_bank_is_in_no_training_bank() -> None:
    kept = {word for name in BANKS for word in held_out(name)}
    trained = {word for name in BANKS for word in bank(name, "train")}
    assert kept | trained == EVERY
    assert not kept & trained


def test_what_the_shipped_world_and_the_generator_call_things_can_be_trained_on() -> None:
    home = load_world(data_folder() / "worlds" / "checkpoint" / "world.yaml")
    made = [generate_world(2, 4, seed) for seed in range(30)]
    posts = {n for world in (home, *made) for n, f in world.frames.items() if f.kind == "post"}
    kinds = {(spec.kind, name.split("_")[0]) for w in made for name, spec in w.assets.items()}
    assert posts <= set(bank("posts", "train"))
    assert {world.base for world in (home, *made)} <= set(bank("bases", "train"))
    assert all(word in bank(kind, "train") for kind, word in kinds)
