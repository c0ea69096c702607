"""`pa-console bench`: what the deterministic parts cost on this machine."""

from typing import Annotated

import typer
from rich.table import Table

from pa_console.cli.output import JsonOption, RulesOption, WorldOption, errors, out, print_json
from pa_console.evaluation.pipeline_bench import bench_pipeline
from pa_console.orchestrator.compose import load_site


def bench(
    world: WorldOption = "checkpoint",
    rules: RulesOption = "checkpoint",
    runs: Annotated[int, typer.Option(min=1, help="Repetitions of each operation.")] = 20,
    json: JsonOption = False,
) -> None:
    """Time retrieval, checks, rehearsal, fork and simulation."""
    site = load_site(world, rules)
    with errors.status("measuring") as status:
        timings = bench_pipeline(site, runs, lambda name: status.update(f"measured: {name}"))
    if json:
        print_json([timing.model_dump(mode="json") for timing in timings])
        return
    table = Table("operation", "median ms", "longest ms", title=f"{runs} runs each")
    for timing in timings:
        table.add_row(
            timing.name, f"{timing.median_s * 1000:.3f}", f"{timing.longest_s * 1000:.3f}"
        )
    out.print(table)
    simulated = timings[-1]
    out.print(f"the simulation runs at {60 / simulated.median_s:.0f} times real time")
