"""Missions while radio, sensors and assets get worse: what is claimed, against the truth."""

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from pa_console.cli.options import ModelOption, RulesOption, WorldOption
from pa_console.evaluation.memo_engine import MemoEngine
from pa_console.llm.local.engine import Engine
from pa_console.llm.models.cache import cache_folder
from pa_console.llm.models.catalogue import find_model
from pa_console.schema.text import count
from pa_console.station.assembly import Site, load_site
from pa_console.terminal.output import errors, out
from tests.benchmarks.degradation.runs import (
    CONDITIONS,
    Disturbance,
    RunFile,
    run_once,
    summarise,
)
from tests.benchmarks.harness import JsonFileOption, Tell, keep, progress, with_engine

COUNTED = (
    "missions", "plans", "halts", "passes", "fails", "unknowns", "false_passes", "rules_broken",
    "resent",
)  # fmt: skip
"""The counts of a row that follow its gap in the table."""


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
    json: JsonFileOption = None,
) -> None:
    """Worsen radio and sensors and let assets fail; compare what is claimed with the truth."""
    site = load_site(world, rules)
    chosen = [condition for condition in CONDITIONS if only in condition.name]
    if not chosen:
        raise ValueError(
            f"--only {only!r} matches no row; rows: {', '.join(c.name for c in CONDITIONS)}"
        )
    weights, kept = find_model(model), RunFile(results)
    name = f"answers{'-exact' * exact}-{weights.fingerprint[:16]}.jsonl"
    memo = MemoEngine(Engine(weights), cache_folder() / name, exact=exact)
    with progress() as tell:
        with_engine(memo, lambda engine: make_runs(site, engine, chosen, kept, runs, tell))
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
            *(str(getattr(row, name)) for name in COUNTED),
        )
        for example in row.examples:
            errors.print(f"{row.condition}: {example}")
    out.print(table)
    out.print(
        f"the model was asked {count(memo.asked, 'time')}, "
        f"{count(memo.reused, 'answer')} came again"
    )
    keep("degradation", rows, json)


async def make_runs(
    site: Site,
    engine: MemoEngine,
    conditions: list[Disturbance],
    kept: RunFile,
    runs: int,
    tell: Tell,
) -> None:
    """Make every run that `kept` does not hold yet."""
    missing = [
        (condition, seed)
        for condition in conditions
        for seed in range(runs)
        if seed not in kept.results(condition.name)
    ]
    for number, (condition, seed) in enumerate(missing):
        tell(f"{condition.name}, seed {seed}", number / len(missing))
        kept.add(condition.name, seed, await run_once(site, engine, condition, seed))
