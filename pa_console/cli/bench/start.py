"""`pa-console bench start`: how long the command line, the screen and the model take to come."""

import re
from collections.abc import Sequence
from typing import Annotated

import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from pa_console.benchmarks.machine import describe_machine
from pa_console.benchmarks.start.start_bench import Screen, StartReport, StartTime, measure_start
from pa_console.cli.output import JsonOption, ModelOption, errors, out, print_json
from pa_console.llm.models.catalogue import find_model

READY = re.compile(r"model \S (?:ready|slow)")
"""What the status bar says of a model that is loaded; on a busy machine it is slow."""


def start(
    model: ModelOption = None,
    runs: Annotated[int, typer.Option(min=1, help="Starts of each kind.")] = 5,
    json: JsonOption = False,
) -> None:
    """Time what starts: verbs, the console's first paint, its model; beside the goals."""
    from pa_console.tui.widgets.mission_prompt import ELSEWHERE  # noqa: PLC0415 - imports Textual

    weights, machine = find_model(model), describe_machine()
    screen = Screen(re.compile(re.escape(ELSEWHERE.split(";", maxsplit=1)[0])), READY)
    columns = (BarColumn(20), TimeElapsedColumn(), TextColumn("{task.description}", markup=False))
    with Progress(*columns, console=errors, transient=True) as progress:
        task = progress.add_task("", total=1.0)
        times, problem = measure_start(
            weights,
            screen,
            runs,
            lambda what, share: progress.update(task, completed=share, description=what),
        )
    if json:
        print_json(
            StartReport(
                machine=machine,
                model=weights.name,
                model_sha256=weights.sha256,
                times=tuple(times),
                cold_problem=problem,
            )
        )
        return
    for line in machine.lines:
        out.print(line, markup=False)
    out.print(f"model {weights.name} ({weights.sha256[:12]}), {runs} starts of each kind")
    out.print(_table(times))
    if problem:
        out.print(f"not measured cold: {problem}")


def _table(times: Sequence[StartTime]) -> Table:
    table = Table("what", box=None, pad_edge=False)
    for name in ("median s", "most s", "goal s", "reached"):
        table.add_column(name, justify="right")
    for time in times:
        goal, reached = "", ""
        if time.goal_s is not None:
            goal, reached = f"{time.goal_s:g}", "yes" if time.median_s <= time.goal_s else "NO"
        name = f"{time.name}, the model's files cold" if time.cold else time.name
        table.add_row(name, f"{time.median_s:.2f}", f"{time.most_s:.2f}", goal, reached)
    return table
