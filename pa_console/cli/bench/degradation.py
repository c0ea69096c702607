"""`pa-console bench degradation`: how missions fare when radio, sensors and assets get worse."""

import asyncio
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import Progress
from rich.table import Table

from pa_console.benchmarks.degradation import (
    CONDITIONS,
    Disturbance,
    Row,
    RunFile,
    run_condition,
    summarise,
)
from pa_console.cli.output import (
    JsonOption,
    ModelOption,
    RulesOption,
    WorldOption,
    errors,
    out,
    print_json,
)
from pa_console.evaluation.runs.memo_engine import MemoEngine
from pa_console.llm.engine.engine import Engine
from pa_console.llm.models.cache import cache_folder
from pa_console.llm.models.catalogue import find_model
from pa_console.orchestrator.station.assembly import Site, load_site
from pa_console.schema.quantities import count


def degradation(
    world: WorldOption = "checkpoint",
    rules: RulesOption = "checkpoint",
    model: ModelOption = None,
    runs: Annotated[int, typer.Option(min=1, help="Seeded runs of each row.")] = 200,
    only: Annotated[str, typer.Option(help="Only the rows whose name contains this.")] = "",
    results: Annotated[
        Path | None,
        typer.Option("--out", help="Keep every run's result in this file, and go on from there."),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Worsen radio and sensors and let assets fail; compare what is claimed with the truth."""
    site = load_site(world, rules)
    chosen = [condition for condition in CONDITIONS if only in condition.name]
    if not chosen:
        raise ValueError(
            f"--only {only!r} matches no row; rows: {', '.join(c.name for c in CONDITIONS)}"
        )
    local = find_model(model)
    memory = cache_folder() / f"answers-{local.fingerprint[:16]}.jsonl"
    engine = MemoEngine(Engine(local), memory)
    rows = asyncio.run(_degrade(site, engine, chosen, RunFile(results), runs))
    if json:
        print_json(rows)
        return
    table = Table(
        "condition", "runs", "all gates within grace", "gap s", "missions", "plans", "halted",
        "pass", "fail", "unknown", "false pass", "rules broken", "resent",
    )  # fmt: skip
    for row in rows:
        table.add_row(
            row.condition,
            str(row.runs),
            f"{row.covered_share:.1%}",
            f"{row.median_longest_gap_s:.1f}",
            *(
                str(value)
                for value in (
                    row.missions, row.plans, row.halts, row.passes, row.fails, row.unknowns,
                    row.false_passes, row.rules_broken, row.resent,
                )
            ),
        )  # fmt: skip
        for example in row.examples:
            errors.print(f"{row.condition}: {example}", markup=False)
    out.print(table)
    out.print(
        f"the model was asked {count(engine.asked, 'time')}, "
        f"{count(engine.reused, 'answer')} came again"
    )


async def _degrade(
    site: Site, engine: MemoEngine, chosen: list[Disturbance], kept: RunFile, runs: int
) -> list[Row]:
    rows: list[Row] = []
    with Progress(console=errors, transient=True) as progress:
        for condition in chosen:
            done = kept.results(condition.name)
            task = progress.add_task(condition.name, total=runs, completed=len(done))
            missing = [seed for seed in range(runs) if seed not in done]
            async for seed, result in run_condition(site, engine, condition, missing):
                done[seed] = result
                kept.add(condition.name, seed, result)
                progress.advance(task)
            rows.append(summarise(condition, [done[seed] for seed in range(runs)]))
    await engine.close()
    return rows
