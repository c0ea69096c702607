"""`pa-console bench`: the parts against the plain way and the limit; more benches below it."""

from typing import Annotated

import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from pa_console.cli import (
    bench_degradation,
    bench_judge,
    bench_retrieval,
    bench_scale,
    bench_twins,
)
from pa_console.cli.bench_table import LEGEND, part_table
from pa_console.cli.output import (
    JsonOption,
    ModelOption,
    RulesOption,
    WorldOption,
    errors,
    out,
    print_json,
)
from pa_console.evaluation.bench.compare import Bench, BenchReport, Comparison
from pa_console.evaluation.bench.parts import PARTS, Part, choose_parts
from pa_console.evaluation.machine import Machine, describe_machine
from pa_console.llm.catalog import LocalModel, find_model
from pa_console.orchestrator.compose import Site, load_site

app = typer.Typer(help="Compare the parts with the plain way and the limit; more benches below.")
app.command("scale")(bench_scale.scale)
app.command("retrieval")(bench_retrieval.retrieval)
app.command("twins")(bench_twins.twins)
app.command("degradation")(bench_degradation.degradation)
app.command("judge")(bench_judge.judge)

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
    found = _measure(site, weights, runs, parts, show=not json)
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
    site: Site, weights: LocalModel | None, runs: int, parts: tuple[Part, ...], *, show: bool
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
            measured = part.measure(Bench(site, weights, runs, tell))
            found += measured
            if show:
                out.print(part_table(part, measured))
    return found
