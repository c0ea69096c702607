"""The same situation twice, which must be the same telemetry."""

import hashlib
from typing import Annotated

import typer
from rich.table import Table

from pa_console.cli.options import WorldOption
from pa_console.evaluation.twin import telemetry_bytes
from pa_console.schema.incident import Scenario
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.worlds.scenario_file import list_scenarios, open_scenario
from pa_console.sim.worlds.world_file import open_world
from pa_console.terminal.output import out
from tests.benchmarks.harness import JsonFileOption, keep, progress


def twins(
    world: WorldOption = "checkpoint",
    seeds: Annotated[int, typer.Option(min=1, help="Seeds 0, 1, ... of each situation.")] = 3,
    json: JsonFileOption = None,
) -> None:
    """Play every situation twice, stepped and forked on the way: telemetry must be equal."""
    played, path = open_world(world)
    names = [name for name, _ in list_scenarios(path)]
    if not names:
        raise ValueError(f"{path.parent}: there is no situation beside this world to be played")
    rows: list[dict[str, object]] = []
    with progress() as tell:
        for name in names:
            scenario = open_scenario(played, path, name).scenario
            for seed in range(seeds):
                tell(f"{name}, seed {seed}", len(rows) / (len(names) * seeds))
                one, other = repeated_hashes(played, scenario, seed)
                rows.append({"scenario": name, "seed": seed, "sha256": one, "equal": one == other})
    table = Table("situation", "seed", "telemetry SHA-256", "equal")
    for row in rows:
        table.add_row(
            str(row["scenario"]),
            str(row["seed"]),
            str(row["sha256"])[:16],
            "yes" if row["equal"] else "NO",
        )
    out.print(table)
    keep("twins", rows, json)
    if not all(row["equal"] for row in rows):
        raise typer.Exit(1)


def repeated_hashes(world: World, scenario: Scenario, seed: int) -> tuple[str, str]:
    """Return the telemetry hashes of a scenario without interference, played twice.

    The second time every picture comes from a fork of the simulation that was made at the one
    before, so that equal hashes also show that a fork goes on exactly as its original.
    """
    every = max(1, round(world.telemetry_period_s / world.dt_s))
    hashes: list[str] = []
    for forked in (False, True):
        sim, telemetry = Checkpoint(world, seed, scenario), hashlib.sha256()
        telemetry.update(telemetry_bytes(sim.picture()))
        while sim.time_s < scenario.duration_s:
            sim = sim.fork() if forked else sim
            for _ in range(every):
                sim.step()
            telemetry.update(telemetry_bytes(sim.picture()))
        hashes.append(telemetry.hexdigest())
    return hashes[0], hashes[1]
