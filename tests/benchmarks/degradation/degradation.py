"""Missions while radio, sensors and assets get worse: what is claimed, against the truth."""

import asyncio
from contextlib import aclosing
from pathlib import Path
from typing import Annotated, NamedTuple

import typer
from rich.progress import Progress
from rich.table import Table

from pa_console.cli.options import (
    ModelOption,
    RulesOption,
    SchedulerOption,
    WorkersOption,
    WorldOption,
    dask_workers,
    one_of,
)
from pa_console.evaluation.memo_engine import MemoEngine
from pa_console.llm.local.engine import Engine
from pa_console.llm.models.cache import cache_folder
from pa_console.llm.models.catalogue import NO_READER, LocalModel, find_model
from pa_console.schema.text import count
from pa_console.station.assembly import Site, load_site
from pa_console.terminal.output import errors, out
from tests.benchmarks.degradation.runs import (
    CONDITIONS,
    Disturbance,
    RunFile,
    run_condition,
    summarise,
)
from tests.benchmarks.figures import JsonFileOption, keep


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
    exact: Annotated[
        bool,
        typer.Option(
            "--exact/--no-exact",
            help="Ask the model for each prompt, also where only a distance, a time or a charge is "
            "another than in one that it has answered: the same file then, whoever made the runs.",
        ),
    ] = False,
    workers: WorkersOption = 0,
    scheduler: SchedulerOption = "",
    json: JsonFileOption = None,
) -> None:
    """Worsen radio and sensors and let assets fail; compare what is claimed with the truth."""
    site = load_site(world, rules)
    chosen = [condition for condition in CONDITIONS if only in condition.name]
    if not chosen:
        raise ValueError(
            f"--only {only!r} matches no row; rows: {', '.join(c.name for c in CONDITIONS)}"
        )
    one_of(workers=bool(workers), scheduler=bool(scheduler))
    local, kept = find_model(model), RunFile(results)
    if workers or scheduler:
        remote = _Remote(local, model, workers or scheduler, exact)
        asked = asyncio.run(_on_dask(site, remote, chosen, kept, runs))
    else:
        name = f"answers{'-exact' * exact}-{local.fingerprint[:16]}.jsonl"
        engine = MemoEngine(Engine(local), cache_folder() / name, exact=exact)
        asked = asyncio.run(_degrade(site, engine, chosen, kept, runs))
    kept.arrange()
    made = {condition.name: kept.results(condition.name) for condition in chosen}
    rows = [summarise(c, [made[c.name][seed] for seed in range(runs)]) for c in chosen]
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
            errors.print(f"{row.condition}: {example}")
    out.print(table)
    out.print(
        f"the model was asked {count(asked.times, 'time')}, "
        f"{count(asked.reused, 'answer')} came again"
    )
    keep("degradation", rows, json)


class _Asked(NamedTuple):
    """How often the model was asked, and how often an answer was there already."""

    times: int
    reused: int


async def _degrade(
    site: Site, engine: MemoEngine, chosen: list[Disturbance], kept: RunFile, runs: int
) -> _Asked:
    """Make what is missing in this process."""
    with Progress(console=errors, transient=True) as progress:
        for condition in chosen:
            done = kept.results(condition.name)
            task = progress.add_task(condition.name, total=runs, completed=len(done))
            missing = [seed for seed in range(runs) if seed not in done]
            async for seed, result in run_condition(site, engine, condition, missing):
                kept.add(condition.name, seed, result)
                progress.advance(task)
    await engine.close()
    return _Asked(engine.asked, engine.reused)


class _Remote(NamedTuple):
    """The model as it is here, what was asked for, where the runs are made, and how it answers."""

    local: LocalModel
    asked: str | None
    where: int | str
    exact: bool


async def _on_dask(
    site: Site, remote: _Remote, chosen: list[Disturbance], kept: RunFile, runs: int
) -> _Asked:
    """Make what is missing on Dask's workers; raises ValueError without Dask, or a scheduler."""
    workers = dask_workers(remote.where)
    from pa_console.evaluation.sweep import ModelOnWorker  # noqa: PLC0415
    from tests.benchmarks.degradation.sweep import DegradationSweep  # noqa: PLC0415 - Dask

    local = remote.local
    names, prints = {local.name: remote.asked}, {local.name: local.fingerprint}
    engine_for = ModelOnWorker(
        names, prints, NO_READER, workers.count, reuse=True, exact=remote.exact
    )
    sweep = DegradationSweep(site, local, engine_for, kept, errors.print)
    wanted = [(condition, seed) for condition in chosen for seed in range(runs)]
    times = reused = 0
    with Progress(console=errors, transient=True) as progress:
        there = {c.name: len(kept.results(c.name)) for c in chosen}
        bars = {n: progress.add_task(n, total=runs, completed=made) for n, made in there.items()}
        async with aclosing(sweep.run(workers, wanted)) as results:
            async for made in results:
                times, reused = times + made.asked, reused + made.reused
                progress.advance(bars[made.condition])
    return _Asked(times, reused)
