"""Seconds from Enter to the decision: typed with live reading and without, and pasted.

Each order is given to a session of its own in real time, after its set-up: key by key, with a pause
before Enter, or all at once. The ways take turns order by order, so that each meets the same load.
At the end comes the memory of the processes that hold the models.
"""

import asyncio
import os
from collections.abc import Sequence
from contextlib import aclosing
from statistics import median, quantiles
from time import perf_counter
from typing import Annotated

import typer
from rich.table import Table

from pa_console.cli.options import ModelOption
from pa_console.evaluation.jobs import load_missions
from pa_console.evaluation.run_record import describe_machine
from pa_console.llm.local.engine import Engine
from pa_console.llm.models.catalogue import NO_READER, find_model
from pa_console.resources import data_folder
from pa_console.schema.base import StrictModel
from pa_console.schema.evaluation import MissionCase
from pa_console.schema.events import event as ev
from pa_console.station.assembly import Site, load_site, open_station
from pa_console.station.clock import RealTimeClock
from pa_console.station.headless import SETUP_SETTLE_S
from pa_console.station.station import ControlStation
from pa_console.terminal.output import out
from tests.benchmarks.harness import (
    JsonFileOption,
    Memory,
    SecondReaderOption,
    Tell,
    introduce,
    keep,
    process_memory,
    progress,
    with_engine,
)

KEY_S = 0.25
"""The time between two keys: four a second."""

PAUSE_S = 0.5
"""The pause before Enter."""

LONG_PAUSE_S = 3.0
"""The pause of an operator who reads the order again, and its reading, before Enter."""

WAYS = ("typed", "typed, 3 s before Enter", "pasted", "typed, live reading off")


class Decided(StrictModel):
    """One order given in one way; `load` is the machine's load average over a minute before it."""

    order: str
    way: str
    seconds: float
    """From Enter to the request for approval, or to the refusal."""
    ahead_s: float
    """Seconds of the models' answers that were written before Enter."""
    shown: bool
    """True if a reading was on the screen at Enter."""
    load: float


async def measure(
    site: Site, engine: Engine, cases: Sequence[MissionCase], tell: Tell
) -> tuple[list[Decided], dict[str, Memory]]:
    """Give each order once in each way; return the decisions, and the memory of each model."""
    decisions: list[Decided] = []
    for case in cases:
        for way in WAYS:
            tell(f"{case.id} {way}", len(decisions) / (len(cases) * len(WAYS)))
            decisions.append(await _given(site, engine, case, way))
    memory = {
        one.name: used
        for one in (engine, engine.second_reader)
        if one is not None and one.pid is not None and (used := process_memory(one.pid))
    }
    return decisions, memory


async def _given(site: Site, engine: Engine, case: MissionCase, way: str) -> Decided:
    station = open_station(site, engine, RealTimeClock(), keep_engine=True)
    shown = ""

    def show(_text: str, reading: str) -> None:
        nonlocal shown
        shown = reading

    station.read_live(None if way.endswith("off") else show)
    following = asyncio.create_task(_until_decided(station))
    await station.advance(SETUP_SETTLE_S)
    for incident in case.setup:
        station.inject(incident)
    await station.advance(SETUP_SETTLE_S)
    load = os.getloadavg()[0]
    if way == "pasted":
        station.typing(case.command)
    else:
        for end in range(1, len(case.command) + 1):
            station.typing(case.command[:end])
            await asyncio.sleep(KEY_S)
        await asyncio.sleep((LONG_PAUSE_S if "3 s" in way else PAUSE_S) - KEY_S)
    readable, started = bool(shown), perf_counter()
    station.submit(case.command)
    ended, ahead_s = await following
    return Decided(
        order=case.command,
        way=way,
        seconds=ended - started,
        ahead_s=ahead_s,
        shown=readable,
        load=load,
    )


async def _until_decided(station: ControlStation) -> tuple[float, float]:
    """Return when the mission waited or was over, and the seconds of answers before Enter."""
    ahead_s = 0.0
    async with aclosing(station.run()) as events:
        async for event in events:
            match event.data:
                case ev.PlanProposed() | ev.PlanJudged() | ev.OrderReadAgain():
                    ahead_s += event.data.usage.ahead_s
                case ev.ApprovalRequested() | ev.MissionFinished():
                    return perf_counter(), ahead_s
                case _:
                    pass
    raise RuntimeError("the session ended before the decision")


def live(
    model: ModelOption = None,
    missions: Annotated[str, typer.Option(help="The mission set of the checkpoint.")] = "paper",
    second_reader: SecondReaderOption = False,
    json: JsonFileOption = None,
) -> None:
    """Measure how soon after Enter a decision waits, with what was read while typing."""
    site = load_site("checkpoint", "checkpoint")
    weights = find_model(model, second_reader="" if second_reader else NO_READER)
    path = data_folder() / "worlds" / "checkpoint" / "missions" / f"{missions}.yaml"
    cases = load_missions(path, site.world).missions
    machine = describe_machine()
    introduce(machine, weights, f"{len(cases)} orders, four keys a second")
    with progress() as tell:
        rows, memory = with_engine(
            Engine(weights), lambda engine: measure(site, engine, cases, tell)
        )
    table = Table("Way", "median", "p95", "most", "ahead", "shown", "load")
    for way in WAYS:
        of_way = [row for row in rows if row.way == way]
        taken = [row.seconds for row in of_way]
        table.add_row(
            way,
            f"{median(taken):.2f} s",
            f"{quantiles(taken, n=20, method='inclusive')[-1]:.2f} s",
            f"{max(taken):.2f} s",
            f"{median(row.ahead_s for row in of_way):.2f} s",
            f"{sum(row.shown for row in of_way)} of {len(of_way)}",
            f"{median(row.load for row in of_way):.1f}",
        )
    out.print(table)
    for name, used in memory.items():
        at_most = f"resident at most {used.peak_mb:.0f} MB"
        out.print(f"process of {name}: {used.pss_mb:.0f} MB (PSS); {at_most}")
    keep("live", {"machine": machine, "decisions": rows, "memory": memory}, json)
