"""`pa-console bench`: the parts against the plain way and the limit; more benches below it."""

from collections.abc import Sequence
from typing import Annotated

import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from pa_console.benchmarks.machine import Machine, describe_machine
from pa_console.benchmarks.speed.compare import Bench, BenchReport, Comparison, Unit, Way
from pa_console.benchmarks.speed.parts import PARTS, Part, choose_parts
from pa_console.cli.bench import degradation, judge, load, retrieval, scale, screen, start, twins
from pa_console.cli.observing import observing
from pa_console.cli.output import (
    JsonOption,
    ModelOption,
    RulesOption,
    TracesOption,
    WorldOption,
    errors,
    out,
    print_json,
)
from pa_console.cli.settings_defaults import settings_of
from pa_console.llm.models.catalogue import LocalModel, find_model
from pa_console.observability.observers import Observer
from pa_console.orchestrator.station.assembly import Site, load_site

LEGEND = (
    "ratio: how many times better ours is: the other's time or memory by ours, or our tokens a "
    "second by the other's. Above 1 ours is better; against a limit, what is below 1 is the share "
    "of it that is reached."
)

_UNITS = ((1.0, "s", 1.0), (1e-3, "ms", 1e3), (0.0, "µs", 1e6))
"""(from this many seconds on, unit, units a second)."""

_SHORT: dict[Unit, str] = {"tokens/s": "t/s", "MB": "MB"}


def part_table(part: Part, comparisons: Sequence[Comparison]) -> Table:
    """Return the table of one part; a note stands under the line that it belongs to."""
    table = Table(title=part.about, title_justify="left")
    table.add_column("what", ratio=3)
    for name in ("ours", "other", "ratio"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("the other way", ratio=2)
    for line in comparisons:
        name = Text(line.name)
        if line.note:
            name.append(f"\n{line.note}", style="dim")
        table.add_row(
            name,
            _figure(line.ours, line.unit),
            "" if line.other is None else _figure(line.other, line.unit),
            "" if line.ratio is None else f"{line.ratio:.3g}x",
            Text("a cost, with nothing beside it" if line.other is None else line.other.what),
        )
    return table


def _figure(way: Way, unit: Unit) -> str:
    if unit != "s":
        return f"{way.median:,.1f} {_SHORT[unit]}"
    size, factor = next((name, by) for least, name, by in _UNITS if way.median >= least)
    return f"{way.median * factor:.3g} {size}"


app = typer.Typer(help="Compare the parts with the plain way and the limit; more benches below.")
app.command("load")(load.load)
app.command("scale")(scale.scale)
app.command("retrieval")(retrieval.retrieval)
app.command("twins")(twins.twins)
app.command("degradation")(degradation.degradation)
app.command("judge")(judge.judge)
app.command("start")(start.start)
app.command("screen")(screen.screen)

COLUMNS = (BarColumn(20), TimeElapsedColumn(), TextColumn("{task.description}", markup=False))


@app.callback(invoke_without_command=True)
def bench(
    context: typer.Context,
    world: WorldOption = "checkpoint",
    rules: RulesOption = "checkpoint",
    model: ModelOption = None,
    runs: Annotated[int, typer.Option(min=1, help="Alternating runs of each comparison.")] = 5,
    only: Annotated[
        list[str] | None,
        typer.Option(help=f"Only this part; may be repeated: {', '.join(p.name for p in PARTS)}."),
    ] = None,
    traces: TracesOption = "",
    json: JsonOption = False,
) -> None:
    """Compare every part with the plain way of doing it, or with its limit, on this machine."""
    if context.invoked_subcommand is not None:
        return
    parts = choose_parts(only or ())
    site = load_site(world, rules)
    weights = find_model(model) if any(part.needs_model for part in parts) else None
    machine = describe_machine()
    if not json:
        _introduce(machine, weights, runs)
    with observing(settings_of(context, traces=traces).values) as beside:
        found = _measure(site, weights, runs, parts, beside.observer, show=not json)
    if json:
        print_json(
            BenchReport(
                machine=machine,
                model=weights.name if weights is not None else "",
                model_sha256=weights.sha256 if weights is not None else "",
                runs=runs,
                comparisons=tuple(found),
            )
        )
    else:
        out.print(LEGEND)


def _introduce(machine: Machine, weights: LocalModel | None, runs: int) -> None:
    for line in machine.lines:
        out.print(line, markup=False)
    model = f"model {weights.name} ({weights.sha256[:12]}), " if weights is not None else ""
    out.print(f"{model}{runs} alternating runs of each way, medians")


def _measure(
    site: Site,
    weights: LocalModel | None,
    runs: int,
    parts: tuple[Part, ...],
    observer: Observer,
    *,
    show: bool,
) -> list[Comparison]:
    """Measure `parts` with a live progress display; each table is shown as soon as it is full."""
    found: list[Comparison] = []
    with Progress(*COLUMNS, console=errors, transient=True) as progress:
        task = progress.add_task("", total=len(parts))
        for number, part in enumerate(parts):

            def tell(what: str, share: float, part: Part = part, number: int = number) -> None:
                words = f"{part.name}: {what}"
                progress.update(task, completed=number + share, description=words)

            tell("starting", 0.0)
            measured = part.measure(Bench(site, weights, runs, tell, observer))
            found += measured
            if show:
                out.print(part_table(part, measured))
    return found
