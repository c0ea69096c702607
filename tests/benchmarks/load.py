"""Seconds that decisions take beside other work, with every number of threads and as we choose it.

The ways take turns mission by mission, so that each meets the same load. Busy processes count in a
loop without end; another console decides about missions, one after the other.
"""

import asyncio
import sys
from collections.abc import AsyncGenerator, Callable, Sequence
from contextlib import asynccontextmanager
from statistics import median
from typing import Annotated

import typer
from rich.table import Table

from pa_console.cli.options import ModelOption, RulesOption, WorldOption
from pa_console.evaluation.run_record import describe_machine
from pa_console.llm.local.engine import Engine
from pa_console.llm.local.threads import physical_cores
from pa_console.llm.models.catalogue import LocalModel, find_model
from pa_console.schema.base import StrictModel
from pa_console.schema.text import count
from pa_console.station.assembly import Site, load_site
from pa_console.terminal.output import out
from tests.benchmarks.harness import JsonFileOption, Tell, introduce, keep, progress
from tests.benchmarks.speed.measured_missions import OurWay, bench_missions

SETTLE_S = 1.0
"""Seconds that a load runs before anything is measured."""

CONSOLE = "another console"
LOADS: tuple[int | str, ...] = (0, 1, 2, 4, CONSOLE)
"""Busy processes beside the console, or the other console."""

COUNT = """
import os, sys, threading
threading.Thread(target=lambda: (sys.stdin.read(), os._exit(0)), daemon=True).start()
while True:
    pass
"""
"""A process that is busy until its parent is gone."""

FOLLOWS = "free cores"


class LoadRow(StrictModel):
    """One way under one load: wall seconds from a mission's words to its verdict."""

    load: str
    way: str
    median_s: float
    most_s: float
    planning_s: float
    """The median of the planner's call alone."""
    missions: int


class LoadReport(StrictModel):
    """The rows, and by load how many times as long our way takes as the best fixed number."""

    rows: tuple[LoadRow, ...]
    ratios: dict[str, float]


async def measure_load(
    site: Site,
    model: LocalModel,
    loads: Sequence[int | str],
    runs: int,
    tell: Tell,
) -> LoadReport:
    """Decide about the benchmark's missions `runs` times in every way under each of `loads`.

    Raises EngineError when a model's process fails.
    """
    cores = physical_cores()
    ways = {FOLLOWS: Engine(model)}
    fixed = sorted({max(1, cores // part) for part in (1, 2, 4)}, reverse=True)
    ways |= {count(n, "thread"): Engine(model, threads=n, fixed=True) for n in fixed}
    rows: list[LoadRow] = []
    try:
        tell("loading the model for each way", 0.0)
        for engine in ways.values():
            await OurWay(site, engine).run(bench_missions(site.world)[0])
        for number, load in enumerate(loads):
            async with _busy(site, model, load):
                await asyncio.sleep(SETTLE_S)

                def share(done: float, load: int | str = load, number: int = number) -> None:
                    tell(_name(load), (number + done) / len(loads))

                rows += await _under(site, ways, _name(load), runs, share)
    finally:
        for engine in ways.values():
            await engine.close()
    return LoadReport(rows=tuple(rows), ratios=_ratios(rows))


async def _under(
    site: Site,
    ways: dict[str, Engine],
    load: str,
    runs: int,
    tell: Callable[[float], None],
) -> list[LoadRow]:
    """Return a row for every way; the first mission of each is not counted."""
    missions = bench_missions(site.world)
    order = [missions[-1], *missions * runs]
    seconds: dict[str, list[tuple[float, float]]] = {way: [] for way in ways}
    for number, mission in enumerate(order):
        tell(number / len(order))
        for way, engine in ways.items():
            pair = await OurWay(site, engine).run(mission)
            if number:
                seconds[way].append((pair.planning_s + pair.judging_s, pair.planning_s))
    return [
        LoadRow(
            load=load,
            way=way,
            median_s=median(whole for whole, _ in found),
            most_s=max(whole for whole, _ in found),
            planning_s=median(planning for _, planning in found),
            missions=len(found),
        )
        for way, found in seconds.items()
    ]


def _ratios(rows: Sequence[LoadRow]) -> dict[str, float]:
    """Return by load our median as a multiple of the best one with a fixed number of threads."""
    found: dict[str, float] = {}
    for load in dict.fromkeys(row.load for row in rows):
        medians = {row.way: row.median_s for row in rows if row.load == load}
        found[load] = medians.pop(FOLLOWS) / min(medians.values())
    return found


def _name(load: int | str) -> str:
    if isinstance(load, str):
        return load
    return "idle" if load == 0 else f"{load} busy process{'es' * (load > 1)}"


@asynccontextmanager
async def _busy(site: Site, model: LocalModel, load: int | str) -> AsyncGenerator[None]:
    """Keep the machine busy in the block."""
    if isinstance(load, str):
        async with _deciding(site, model):
            yield
        return
    processes = [
        await asyncio.create_subprocess_exec(
            sys.executable, "-c", COUNT, stdin=asyncio.subprocess.PIPE, start_new_session=True
        )
        for _ in range(load)
    ]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            await process.wait()


@asynccontextmanager
async def _deciding(site: Site, model: LocalModel) -> AsyncGenerator[None]:
    """Have another console's model decide about missions in the block, one after the other."""
    engine = Engine(model)
    other = OurWay(site, engine)

    async def decide() -> None:
        while True:
            for mission in bench_missions(site.world):
                await other.run(mission)

    task = asyncio.create_task(decide())
    try:
        yield
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        await engine.close()


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
    json: JsonFileOption = None,
) -> None:
    """Time decisions beside busy processes and another console, with every number of threads."""
    loads = [_load(text) for text in beside] if beside else LOADS
    site, weights, machine = load_site(world, rules), find_model(model), describe_machine()
    introduce(machine, weights, f"{runs} rounds of each way")
    with progress() as tell:
        report = asyncio.run(measure_load(site, weights, loads, runs, tell))
    out.print(_table(report, weights.name))
    keep("load", {"machine": machine, "model": weights.name, "report": report}, json)


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
