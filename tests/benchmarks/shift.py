"""A shift of hours in minutes: visitors, faults, an operator who answers late and goes away.

The world runs as fast as it can, but second by second while a model works for a mission: a slow
machine is slow in the shift, too. Counted is the truth of the simulation: gates without a guard
that no alert has told of, assets whose battery is empty, the memory, and whether the log is sound.
"""

import asyncio
import gc
import hashlib
import os
import tempfile
from collections import Counter
from collections.abc import Callable
from contextlib import aclosing
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from time import perf_counter
from typing import Annotated

import psutil
import typer
from rich.table import Table

from pa_console.cli.options import ModelOption
from pa_console.evaluation.run_record import describe_machine
from pa_console.fleets.simulated import SimulatedFleet
from pa_console.llm.local.engine import Engine
from pa_console.llm.models.catalogue import NO_READER, find_model
from pa_console.mission.approval import inadmissible
from pa_console.schema.base import StrictModel
from pa_console.schema.events import event as ev
from pa_console.schema.mission import AlarmKind, Decision
from pa_console.schema.text import clock_text
from pa_console.session.log.verification import verify
from pa_console.session.log.writer import LogWriter
from pa_console.session.state import SessionState
from pa_console.signing import load_signer
from pa_console.sim.worlds.scenario_file import LoadedScenario, load_scenario
from pa_console.station.alarms.alerts import AlertRules
from pa_console.station.assembly import Site, load_site, open_station
from pa_console.station.station import ControlStation
from pa_console.terminal.output import errors, out
from tests.benchmarks.harness import (
    JsonFileOption,
    SecondReaderOption,
    Tell,
    introduce,
    keep,
    progress,
    with_engine,
)

SCENARIO = Path(__file__).with_name("long-shift.yaml")
HOUR_S = 3600.0
TOLD_WITHIN_S = 5.0
"""An alert tells of an uncovered gate so long after the grace time of a hand-over at the latest."""
MOST_GROWTH = 0.05
"""The share by which the memory may grow after the first eighth of the shift."""
SPRINT = 5
"""The steps of the world between two looks at the events, while no model works for a mission."""
UNCOVERED: tuple[AlarmKind, ...] = ("coverage_lost", "coverage_unknown")
ALERT_FROM, ALERT_AFTER_S = "high", 300.0
"""The settings of alerts as they are shipped."""


class Gap(StrictModel):
    """A gate that had no guard for longer than a hand-over may take."""

    gate: str
    since_s: float
    seconds: float
    told_after_s: float | None
    """Seconds from the beginning to the alert that told of it, None if none did in time."""


class Flat(StrictModel):
    """An asset whose battery ran empty."""

    asset: str
    at_s: float


class ShiftReport(StrictModel):
    """The figures of one shift; memory is that of the console's own process."""

    hours: float
    seed: int
    wall_s: float
    load: float
    """The machine's load average over the last minute of the shift."""
    answer_s: float
    away_h: float
    missions: dict[str, int]
    reliefs: int
    """The missions that the low-battery policy started."""
    unasked: int
    """The plans that it approved by itself."""
    asked: int
    """The plans that waited for the operator."""
    alerts: int
    gaps: tuple[Gap, ...]
    flat: tuple[Flat, ...]
    least_battery: dict[str, float]
    memory_mb: tuple[float, ...]
    """At each eighth of the shift."""
    log_mb: float
    records: int
    log_problem: str
    """Why the log is not vouched for to its end, '' if it is."""

    @property
    def untold(self) -> int:
        """The number of uncovered gates that no alert told of in time."""
        return sum(gap.told_after_s is None for gap in self.gaps)

    @property
    def growth(self) -> float:
        """The growth of the memory after the first eighth, as a share."""
        first, *rest = self.memory_mb or (0.0,)
        return max(rest, default=first) / first - 1.0 if first else 0.0

    @property
    def missed(self) -> list[str]:
        """The aims that were missed."""
        aims = {
            f"{self.untold} uncovered gates without an alert": self.untold > 0,
            f"{len(self.flat)} assets ran flat": bool(self.flat),
            f"the memory grew by {self.growth:.0%}": self.growth > MOST_GROWTH,
            f"the log: {self.log_problem}": bool(self.log_problem),
        }
        return [what for what, so in aims.items() if so]


class ShiftClock:
    """As fast as possible, but in real time while a model works for a mission."""

    waits = False
    rate = 1.0

    def __init__(self) -> None:
        self.thinking: Callable[[], bool] = lambda: False
        self._last = perf_counter()
        self._owed = 0.0

    async def due(self, dt_s: float, waiting: Callable[[], bool]) -> int:
        """Return the steps to take now."""
        if not self.thinking():
            await asyncio.sleep(0.0)
            self._last = perf_counter()
            return SPRINT
        await asyncio.sleep(dt_s)
        now = perf_counter()
        self._owed += (now - self._last) / dt_s
        self._last = now
        steps = int(self._owed)
        self._owed -= steps
        return steps


class LateOperator:
    """Answers after a while, and not at all while away; rejects what the judge objects to."""

    def __init__(
        self, station: ControlStation, rng: Random, answer_s: float, away: tuple[float, float]
    ) -> None:
        self._station, self._rng, self._answer_s, self._away = station, rng, answer_s, away
        self._asked: ev.ApprovalRequested | None = None
        self._answers_at = 0.0
        self._looks_at = 0.0
        self.asked = 0
        """The number of plans and questions that waited for an answer."""

    def take(self, event: ev.Event, state: SessionState, now_s: float) -> None:
        """Act if it is time to; `state` has the event already."""
        data = event.data
        if isinstance(data, ev.ApprovalRequested):
            self._asked, self._answers_at = data, now_s + self._delay()
        if self._asked is None or not self._station.awaits_decision:
            self._asked = None
        if not isinstance(data, ev.TelemetryReceived) or self._away[0] <= now_s < self._away[1]:
            return
        if self._asked is not None and now_s >= self._answers_at:
            self.asked += 1
            request, self._asked = self._asked, None
            self._station.decide(self._decision(request))
        if now_s >= self._looks_at:
            self._looks_at = now_s + self._delay()
            for item in state.alarms:
                if not item.acknowledged:
                    self._station.acknowledge(item.alarm.id)

    def _delay(self) -> float:
        return self._rng.uniform(0.2, 1.8) * self._answer_s

    def _decision(self, request: ev.ApprovalRequested) -> Decision:
        approved = request.approved("seen by eye")
        objects = request.needs_override
        if problem := "the judge objects" if objects else inadmissible(request, approved):
            return request.decided("reject", reason=problem)
        return approved


@dataclass
class _OpenGap:
    since_s: float
    told_s: float | None = None
    decided: bool = False


@dataclass
class Watch:
    """Compares the truth with what alerts have told."""

    grace_s: float
    rules: AlertRules = field(default_factory=lambda: AlertRules(ALERT_FROM, ALERT_AFTER_S))
    gaps: list[Gap] = field(default_factory=list[Gap])
    flat: dict[str, Flat] = field(default_factory=dict[str, Flat])
    least: dict[str, float] = field(default_factory=dict[str, float])
    alerts: int = 0
    _open: dict[str, _OpenGap] = field(default_factory=dict[str, _OpenGap])
    _told: dict[str, float] = field(default_factory=dict[str, float])
    """When an alert named a gate last."""

    def take(self, event: ev.Event, state: SessionState, fleet: SimulatedFleet) -> None:
        """Take in an event that is in `state` already."""
        now_s = event.tick * fleet.world.dt_s
        self.rules.take(event, now_s)
        if not isinstance(event.data, ev.TelemetryReceived):
            return
        for message in self.rules.due(now_s):
            self.alerts += 1
            self._told |= {
                gate: now_s
                for gate in fleet.world.gates
                if gate in f"{message.title}\n{message.body}"
            }
        truth = fleet.checkpoint.truth()
        for name, asset in truth.assets.items():
            charge = asset.battery_pct
            self.least[name] = min(self.least.get(name, 100.0), round(charge, 1))
            if charge <= 0.0 and name not in self.flat:
                self.flat[name] = Flat(asset=name, at_s=now_s)
        for gate, cover in truth.gates.items():
            self._gate(gate, state, now_s, covered=cover.covered)

    def _gate(self, gate: str, state: SessionState, now_s: float, *, covered: bool) -> None:
        gap = self._open.get(gate)
        if covered:
            if gap is not None:
                self._end(gate, gap, now_s)
                del self._open[gate]
            return
        gap = self._open.setdefault(gate, _OpenGap(now_s))
        in_time = now_s - gap.since_s <= self.grace_s + TOLD_WITHIN_S
        if gap.told_s is None and in_time and self._told_of(gate, state):
            gap.told_s = max(0.0, self._told[gate] - gap.since_s)

    def _told_of(self, gate: str, state: SessionState) -> bool:
        """Return whether an alert has told of an alarm that is open about the cover of a gate."""
        raised = [
            item.alarm.raised_s
            for item in state.alarms
            if item.alarm.gate == gate and item.alarm.kind in UNCOVERED
        ]
        return any(self._told.get(gate, -1.0) >= at for at in raised)

    def _end(self, gate: str, gap: _OpenGap, now_s: float) -> None:
        seconds = now_s - gap.since_s
        if seconds > self.grace_s:
            self.gaps.append(
                Gap(gate=gate, since_s=gap.since_s, seconds=seconds, told_after_s=gap.told_s)
            )

    def close(self, now_s: float) -> None:
        """End what is still open at the end of the shift."""
        for gate, gap in self._open.items():
            self._end(gate, gap, now_s)


def _thinks(state: SessionState, station: ControlStation) -> bool:
    """Return whether a mission is being read, planned, checked or judged."""
    trace = state.missions.get(state.active or "")
    return (
        trace is not None
        and not station.awaits_decision
        and trace.stage not in ("queued", "decide", "execute", "verify", "finished")
    )


async def work_shift(
    site: Site,
    engine: Engine,
    *,
    hours: float,
    seed: int,
    answer_s: float,
    away_h: float,
    folder: Path,
    tell: Tell,
) -> ShiftReport:
    """Work one shift with the shipped low-battery policy, and return what came of it."""
    world, began = site.world, perf_counter()
    scenario = load_scenario(SCENARIO, world)
    fleet = SimulatedFleet.start(world, seed, scenario)
    clock, state, memory = ShiftClock(), SessionState(), list[float]()
    loaded = LoadedScenario(scenario, hashlib.sha256(SCENARIO.read_bytes()).hexdigest())
    station = open_station(
        site, engine, clock, seed=seed, scenario=loaded, respond=True, fleet=fleet, keep_engine=True
    )
    clock.thinking = lambda: engine.busy or _thinks(state, station)
    if world.low_battery_policy:
        station.offer_at_start(world.low_battery_policy)
    end_s = hours * HOUR_S
    middle, half_s = end_s / 2, min(away_h * HOUR_S, end_s) / 2
    operator = LateOperator(station, Random(seed), answer_s, (middle - half_s, middle + half_s))
    watch, process = Watch(world.coverage_grace_s), psutil.Process()
    problems: list[str] = []
    unasked = records = 0
    path = folder / "shift.jsonl"
    with LogWriter(
        path, station.session, signer=load_signer(), on_error=lambda e: problems.append(str(e))
    ) as log:
        station.write_to(log)
        async with aclosing(station.run()) as events:
            async for event in events:
                records += 1
                state.apply(event)
                watch.take(event, state, fleet)
                operator.take(event, state, fleet.time_s)
                if isinstance(event.data, ev.DecisionMade):
                    unasked += bool(event.data.decision.standing_order)
                if not isinstance(event.data, ev.TelemetryReceived):
                    continue
                while fleet.time_s >= (len(memory) + 1) * end_s / 8 and len(memory) < 8:
                    gc.collect()
                    memory.append(process.memory_info().rss / 1e6)
                tell(
                    f"{clock_text(fleet.time_s)}, {len(state.missions)} missions",
                    min(fleet.time_s / end_s, 1.0),
                )
                if fleet.time_s >= end_s:
                    break
            await station.close("the shift is over")
            watch.close(fleet.time_s)
    result = verify(path)
    starts = sum(len(order.starts) for order in state.standing.values())
    sound = "" if result.intact else result.problem or result.note or "not signed to its end"
    return ShiftReport(
        hours=hours,
        seed=seed,
        wall_s=perf_counter() - began,
        load=os.getloadavg()[0],
        answer_s=answer_s,
        away_h=away_h,
        missions=dict(Counter(str(trace.status) for trace in state.missions.values())),
        reliefs=starts,
        unasked=unasked,
        asked=operator.asked,
        alerts=watch.alerts,
        gaps=tuple(watch.gaps),
        flat=tuple(watch.flat.values()),
        least_battery=watch.least,
        memory_mb=tuple(round(size, 1) for size in memory),
        log_mb=path.stat().st_size / 1e6,
        records=records,
        log_problem="; ".join([*problems, sound] if sound else problems),
    )


def show_report(report: ShiftReport) -> None:
    """Print the figures as a table."""
    ended = ", ".join(f"{number} {status}" for status, number in report.missions.items())
    gaps = f"{len(report.gaps)}, longest {max((g.seconds for g in report.gaps), default=0):.0f} s"
    told = [gap.told_after_s for gap in report.gaps if gap.told_after_s is not None]
    lowest = min(report.least_battery, key=report.least_battery.__getitem__, default="")
    table = Table("figure", "value", title=f"{report.hours:g} hours, seed {report.seed}")
    for name, value in (
        ("wall time", f"{report.wall_s / 60:.1f} min, load {report.load:.1f}"),
        ("missions", ended or "none"),
        ("started by the low-battery policy", f"{report.reliefs}"),
        ("plans it approved, plans that waited", f"{report.unasked}, {report.asked}"),
        ("alerts", f"{report.alerts}"),
        ("gates without a guard beyond the grace time", gaps),
        ("  of them without an alert in time", f"{report.untold}"),
        ("  latest alert", f"{max(told, default=0.0):.1f} s after the guard had gone"),
        ("assets that ran flat", ", ".join(each.asset for each in report.flat) or "none"),
        ("lowest charge", f"{report.least_battery.get(lowest, 0.0):.1f} %, {lowest}"),
        ("memory after each eighth, MB", " ".join(f"{size:.0f}" for size in report.memory_mb)),
        ("growth after the first eighth", f"{report.growth:+.1%}"),
        ("events, size of the log", f"{report.records}, {report.log_mb:.0f} MB"),
        ("the log is", report.log_problem or "signed and sound to its end"),
    ):
        table.add_row(name, value)
    out.print(table)


def shift(
    model: ModelOption = None,
    hours: Annotated[float, typer.Option(min=0.05, help="Hours of the site's clock.")] = 8.0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulation.")] = 0,
    answer: Annotated[
        float, typer.Option(min=0.0, help="Seconds after which the operator answers, about.")
    ] = 90.0,
    away: Annotated[
        float, typer.Option(min=0.0, help="Hours in the middle without an operator.")
    ] = 2.0,
    second_reader: SecondReaderOption = False,
    log: Annotated[
        Path | None, typer.Option(help="Folder that keeps the shift's log.", file_okay=False)
    ] = None,
    json: JsonFileOption = None,
) -> None:
    """Work a simulated shift; ends with 1 if a gate, a battery, the memory or the log fails."""
    site = load_site("checkpoint", "checkpoint")
    weights = find_model(model, second_reader="" if second_reader else NO_READER)
    introduce(describe_machine(), weights, f"a shift of {hours:g} hours, {away:g} of them alone")
    if log is not None:
        log.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder, progress() as tell:
        report = with_engine(
            Engine(weights),
            lambda engine: work_shift(
                site, engine, hours=hours, seed=seed, answer_s=answer, away_h=away,
                folder=log or Path(folder), tell=tell,
            ),
        )  # fmt: skip
    show_report(report)
    keep("shift", report, json)
    if report.missed:
        errors.print_line(f"missed: {'; '.join(report.missed)}", style="bold red")
        raise typer.Exit(1)
