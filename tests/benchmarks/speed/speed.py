"""Every part of the console against the plain way of doing it, or against its limit."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated

import typer
from rapidfuzz import process
from rich.table import Table
from rich.text import Text

from pa_console.cli.options import ModelOption, RulesOption, WorldOption
from pa_console.evaluation.run_record import describe_machine
from pa_console.llm.models.catalogue import LocalModel, find_model
from pa_console.station.assembly import Site, load_site
from pa_console.terminal.output import out
from tests.benchmarks.harness import JsonFileOption, introduce, keep, progress
from tests.benchmarks.speed.compare import Bench, BenchReport, Comparison, Unit, Way
from tests.benchmarks.speed.decoding import measure_decoding
from tests.benchmarks.speed.missions import measure_missions
from tests.benchmarks.speed.without_model import (
    measure_checks,
    measure_rehearsal,
    measure_retrieval,
)


@dataclass(frozen=True)
class Part:
    """One part of the benchmark."""

    name: str
    about: str
    measure: Callable[[Bench], list[Comparison]]
    needs_model: bool = False


PARTS: tuple[Part, ...] = (
    Part("retrieval", "Retrieval against a plain loop", measure_retrieval),
    Part("checks", "Checks in CEL", measure_checks),
    Part("rehearsal", "Rehearsal, fork and forecast", measure_rehearsal),
    Part("decoding", "Planner against bare llama.cpp", measure_decoding, needs_model=True),
    Part("missions", "Missions against the plain way", measure_missions, needs_model=True),
)
"""Quick ones first, so that an interrupted run has shown something."""


def choose_parts(names: Sequence[str]) -> tuple[Part, ...]:
    """Return the parts called `names`, all without any; raises ValueError for an unknown name."""
    known = {part.name: part for part in PARTS}
    for name in names:
        if name not in known:
            nearest = process.extractOne(name, list(known), score_cutoff=60)
            hint = f" Did you mean {nearest[0]}?" if nearest else ""
            raise ValueError(
                f"--only {name!r} is no part of the benchmark.{hint} Parts: {', '.join(known)}"
            )
    return tuple(part for part in PARTS if not names or part.name in names)


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


def speed(
    context: typer.Context,
    world: WorldOption = "checkpoint",
    rules: RulesOption = "checkpoint",
    model: ModelOption = None,
    runs: Annotated[int, typer.Option(min=1, help="Alternating runs of each comparison.")] = 5,
    only: Annotated[
        list[str] | None,
        typer.Option(help=f"Only this part; may be repeated: {', '.join(p.name for p in PARTS)}."),
    ] = None,
    json: JsonFileOption = None,
) -> None:
    """Compare every part with the plain way of doing it, or with its limit, on this machine."""
    if context.invoked_subcommand is not None:
        return
    parts = choose_parts(only or ())
    site = load_site(world, rules)
    weights = find_model(model) if any(part.needs_model for part in parts) else None
    machine = describe_machine()
    introduce(machine, weights, f"{runs} alternating runs of each way, medians")
    found = _measure(site, weights, runs, parts)
    out.print(LEGEND)
    report = BenchReport(
        machine=machine,
        model=weights.name if weights is not None else "",
        model_sha256=weights.sha256 if weights is not None else "",
        runs=runs,
        comparisons=tuple(found),
    )
    keep("speed", report, json)


def _measure(
    site: Site, weights: LocalModel | None, runs: int, parts: tuple[Part, ...]
) -> list[Comparison]:
    """Measure `parts` and show the table of each as soon as it is complete."""
    comparisons: list[Comparison] = []
    with progress() as tell:
        for number, part in enumerate(parts):

            def tell_part(what: str, share: float, part: Part = part, number: int = number) -> None:
                tell(f"{part.name}: {what}", (number + share) / len(parts))

            tell_part("starting", 0.0)
            measured = part.measure(Bench(site, weights, runs, tell_part))
            comparisons += measured
            out.print(part_table(part, measured))
    return comparisons
