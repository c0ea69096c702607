"""The simulation takes the same steps as ever, in every scenario and in generated worlds."""

from collections.abc import Iterator

from pa_console.resources import data_folder
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.worlds.scenario_file import load_scenario
from pa_console.sim.worlds.world_file import load_world
from pa_console.sim.worlds.world_generator import generate_world
from tests.golden.stored import compare, read, write

STEPS = (0, 1, 100, 2000)
"""After so many ticks the state is compared."""
SEEDS = (0, 7)
GENERATED = {"three gates": (3, 6, 11), "eight gates": (8, 24, 12)}
"""Worlds of the generator: gates, assets, seed."""
FAR = 500
"""Ticks that are looked at in generated worlds."""


def record() -> None:
    """Write what is so now."""
    write("state_hash.json", _hashes())


def test_every_scenario_and_generated_world_comes_to_the_same_states() -> None:
    compare("state_hash", read("state_hash.json"), _hashes())


def _hashes() -> dict[str, dict[str, str]]:
    return dict(_all())


def _all() -> Iterator[tuple[str, dict[str, str]]]:
    """Yield the hashes of every case by its name."""
    folder = data_folder() / "worlds" / "checkpoint"
    world = load_world(folder / "world.yaml")
    for seed in SEEDS:
        yield f"no scenario, seed {seed}", _states(Checkpoint(world, seed), STEPS)
    for number, path in enumerate(sorted(folder.glob("scenarios/*.yaml"))):
        seed = SEEDS[number % len(SEEDS)]
        sim = Checkpoint(world, seed, load_scenario(path, world))
        yield f"{path.stem}, seed {seed}", _states(sim, STEPS)
    for name, numbers in GENERATED.items():
        steps = [step for step in STEPS if step < FAR] + [FAR]
        yield name, _states(Checkpoint(generate_world(*numbers), 3), steps)


def _states(sim: Checkpoint, steps: tuple[int, ...] | list[int]) -> dict[str, str]:
    """Return the hash of the state after each of so many ticks."""
    found: dict[str, str] = {}
    for step in steps:
        while sim.tick < step:
            sim.step()
        found[f"tick {step}"] = sim.state_hash()
    return found
