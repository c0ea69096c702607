"""`pa-console bench load`: how long decisions take on a machine that has other work to do."""

import asyncio
from typing import Annotated

import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from pa_console.benchmarks.machine import describe_machine
from pa_console.benchmarks.speed.load import CONSOLE, LOADS, LoadReport, measure_load
from pa_console.cli.output import (
    JsonOption,
    ModelOption,
    RulesOption,
    WorldOption,
    errors,
    out,
    print_json,
)
from pa_console.llm.models.catalogue import find_model
from pa_console.orchestrator.station.assembly import load_site

MOST_PROCESSES = 64


def load(
    world: WorldOption = "checkpoint",
    rules: RulesOption = "checkpoint",
    model: ModelOption = None,
    runs: Annotated[int, typer.Option(min=1, help="Rounds of the four missions a way.")] = 2,
    beside: Annotated[
        list[str] | None,
        typer.Option(
            help=f"Beside so many busy processes, or '{CONSOLE}'; repeatable. By default all of "
            f"{', '.join(map(str, LOADS))}."
        ),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Time decisions beside busy processes and another console, with every number of threads."""
    loads = [_load(text) for text in beside] if beside else LOADS
    site, weights, machine = load_site(world, rules), find_model(model), describe_machine()
    with Progress(
        BarColumn(20),
        TimeElapsedColumn(),
        TextColumn("{task.description}", markup=False),
        console=errors,
        transient=True,
    ) as progress:
        task = progress.add_task("", total=1.0)
        report = asyncio.run(
            measure_load(
                site,
                weights,
                loads,
                runs,
                lambda what, share: progress.update(task, completed=share, description=what),
            )
        )
    if json:
        print_json({"machine": machine, "model": weights.name, "report": report})
        return
    for line in machine.lines:
        out.print(line, markup=False)
    out.print(_table(report, weights.name))


def _load(text: str) -> int | str:
    """Read one --beside; raises ValueError for what it cannot be."""
    if text == CONSOLE:
        return text
    if text.isdecimal() and int(text) <= MOST_PROCESSES:
        return int(text)
    raise ValueError(f"--beside {text!r}: give 0 to {MOST_PROCESSES}, or '{CONSOLE}'")


def _table(report: LoadReport, model: str) -> Table:
    table = Table(title=f"{model}: seconds from a mission's words to its verdict")
    table.title_justify = "left"
    table.add_column("beside")
    table.add_column("threads")
    for name in ("median", "most", "planner", "against the best"):
        table.add_column(name, justify="right")
    last = ""
    for row in report.rows:
        first, last = row.load != last, row.load
        if first and table.row_count:
            table.add_section()
        table.add_row(
            row.load if first else "",
            row.way,
            f"{row.median_s:.2f}",
            f"{row.most_s:.2f}",
            f"{row.planning_s:.2f}",
            f"{report.ratios[row.load]:.2f}x" if first else "",
        )
    return table
