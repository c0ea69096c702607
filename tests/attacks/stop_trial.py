"""One random mission, stopped at a random moment: what left the station before and after.

The station, its world and its safeguards are the real ones; only the LLM is scripted. What is sent
is counted at the simulation itself, below everything that decides.
"""

import asyncio
import random
from collections import Counter
from collections.abc import AsyncGenerator, Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import aclosing, suppress
from dataclasses import dataclass, field
from functools import cache
from time import perf_counter

from pa_console.fleets.simulated import SimulatedFleet
from pa_console.llm.backend import GenerationEnd, Request
from pa_console.mission.approval import standing_approver
from pa_console.schema.command import COMMANDS, CommandReply, DeviceCommand, Verb
from pa_console.schema.evaluation import Variant
from pa_console.schema.events import event as ev
from pa_console.schema.incident import (
    FailAsset,
    Incident,
    Scenario,
    ScriptedEvent,
    SetRadio,
    SpawnTrack,
)
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.picture import period_ticks
from pa_console.sim.worlds.scenario_file import LoadedScenario
from pa_console.sim.worlds.terrain import Terrain
from pa_console.station.assembly import Site, load_site, open_station
from pa_console.station.station import ControlStation
from tests.scripted import ScriptedEngine, plan

AFTER_TICKS = 80
"""So long is looked at what happens after a stop: 8 simulated seconds."""

LATEST_TICK = 120
CHUNK = 10
"""So many trials one process makes before it takes up others."""
STILL = ("hold", "report")

RELIEF = plan(("Drone_T01", "move_to EastGate"), ("Drone_T04", "move_to WestGate"))
WORKFLOW = (
    plan(("Drone_T04", "observe WestGate")),
    plan(("Robot_T01", "identify WestGate")),
    plan(("Robot_T01", "warn WestGate")),
)
FAR, FILL = plan(("Robot_T02", "move_to WestGate")), plan(("Drone_T04", "move_to EastGate"))

KINDS = ("one", "queue", "halted", "cancelled", "pre-empted", "workflow", "idle")
"""What goes on when everything is stopped."""


class LiveClock:
    """The world goes on whether anybody waits for it or not, as in a console."""

    rate = 1.0
    waits = False

    async def due(self, dt_s: float, waiting: Callable[[], bool]) -> int:
        """Return one step after every turn of the event loop."""
        await asyncio.sleep(0)
        return 1


class SlowEngine(ScriptedEngine):
    """A scripted model that takes some turns of the event loop for every answer."""

    turns = 0

    async def generate(self, request: Request) -> AsyncGenerator[str | GenerationEnd]:
        """Think, then answer."""
        for _ in range(self.turns):
            await asyncio.sleep(0)
        async for piece in super().generate(request):
            yield piece


@dataclass
class Trial:
    """What one trial came to."""

    kind: str = ""
    before: list[DeviceCommand] = field(default_factory=list[DeviceCommand])
    after: list[DeviceCommand] = field(default_factory=list[DeviceCommand])
    events: list[ev.Event] = field(default_factory=list[ev.Event])
    started_after: list[str] = field(default_factory=list[str])
    """Missions that began or arrived after the stop."""
    held_s: list[float] = field(default_factory=list[float])
    """Seconds from each order to stop to the last of its holds on the link."""

    @property
    def moved_after(self) -> list[str]:
        """The commands after the stop that move an asset."""
        return [_words(command) for command in self.after if command.verb not in STILL]

    @property
    def undecided(self) -> list[str]:
        """The commands that nobody approved and no way to safety declared, holds included."""
        allowed, requests = set[tuple[str, str, str]](), dict[str, ev.ApprovalRequested]()
        for event in self.events:
            match event.data:
                case ev.ApprovalRequested():
                    requests[str(event.mission)] = event.data
                case ev.DecisionMade(accepted=True, decision=decision):
                    request = requests[str(event.mission)]
                    if decision.kind == "approve":
                        declared = (*request.plan.actions, *request.if_halted)
                        holds = [(action.agent, "hold") for action in request.if_halted]
                        orders = [(action.agent, action.command) for action in declared]
                        mission = str(event.mission)
                        allowed |= {(mission, *order) for order in (*orders, *holds)}
                case _:
                    pass
        sent = [c for c in (*self.before, *self.after) if not c.command_id.startswith("stop")]
        return [
            _words(c)
            for c in sent
            if (c.command_id.split(".")[0], c.agent, _order(c)) not in allowed
        ]


def _order(command: DeviceCommand) -> str:
    return f"{command.verb} {command.target or ''}".strip()


def _words(command: DeviceCommand) -> str:
    return f"{command.agent} {_order(command)}"


@cache
def checkpoint() -> Site:
    """Return the checkpoint with its rules."""
    return load_site("checkpoint", "checkpoint")


@cache
def _terrain() -> Terrain:
    return Terrain(checkpoint().world)


class Tapped(Checkpoint):
    """A checkpoint that tells of every command and every step; all share one terrain."""

    def __init__(self, site: Site, seed: int, scenario: Scenario | None) -> None:
        self.world, self.scenario = site.world, scenario
        self._terrain, self._period = _terrain(), period_ticks(site.world)
        self.reset(seed)
        self.on_send: Callable[[DeviceCommand], object] = lambda _: None
        self.on_step: Callable[[int], object] = lambda _: None

    def send(self, command: DeviceCommand) -> None:
        """Tell, then put it on the link."""
        self.on_send(command)
        super().send(command)

    def step(self) -> list[CommandReply]:
        """Move on, then tell."""
        replies = super().step()
        self.on_step(self.tick)
        return replies


def random_plan(rng: random.Random, site: Site) -> str:
    """Return a plan that can be started, for one to four assets, wherever it leads."""
    world = site.world
    orders: list[tuple[str, str]] = []
    for name in rng.sample(list(world.assets), rng.randint(1, 4)):
        kind = world.assets[name].kind
        able: list[Verb] = [verb for verb, spec in COMMANDS.items() if kind in spec.kinds]
        moving: list[Verb] = [verb for verb in able if verb not in STILL]
        verb = rng.choice(moving if rng.random() < 0.9 else able)
        target = f" {rng.choice(list(world.frames))}" if COMMANDS[verb].takes_frame else ""
        orders.append((name, verb + target))
    return plan(*orders)


def _script(kind: str, rng: random.Random, site: Site) -> Iterator[tuple[float, Incident]]:
    """Yield what happens in the world, and when in simulated seconds."""
    if rng.random() < 0.5:
        late_s, jitter_s = rng.uniform(0, 1.5), rng.uniform(0, 0.8)
        loss = rng.choice([0.0, 0.2, 0.5, 0.8])
        yield 0.0, SetRadio(loss=loss, latency_s=late_s, jitter_s=jitter_s)
    if rng.random() < 0.3:
        asset, since = rng.choice(list(site.world.assets)), rng.uniform(0, 16)
        yield since, SetRadio(asset=asset, up=False)
        yield since + rng.uniform(1, 15), SetRadio(asset=asset)
    match kind:
        case "halted":
            for name in ("Drone_T04", "Drone_T01"):
                yield rng.uniform(0.5, 10), FailAsset(asset=name)
        case "pre-empted":
            yield rng.uniform(0.5, 10), FailAsset(asset="Ugv_T01")
        case "workflow":
            gate = "WestGate"
            yield 0.2, SpawnTrack(gate=gate, distance_m=60.0, name="V1", when_warned="leave")
        case _:
            pass
    if rng.random() < 0.5:
        yield rng.uniform(5, 25), SpawnTrack(gate="NorthGate", distance_m=60.0, intent="hostile")
        yield rng.uniform(5, 25), FailAsset(asset="Ugv_T02")


def _plans(kind: str, rng: random.Random, site: Site) -> list[str]:
    match kind:
        case "workflow":
            return list(WORKFLOW)
        case "pre-empted":
            return [FAR, FILL, FAR]
        case "one" | "queue":
            return [rng.choice([RELIEF, random_plan(rng, site)]) for _ in range(4)]
        case _:
            return [RELIEF, *(random_plan(rng, site) for _ in range(3))]


async def stop_at_random(seed: int) -> Trial:
    """Let a random mission begin, stop everything at a random moment and look what is sent."""
    rng, site = random.Random(seed), checkpoint()
    kind = rng.choice(KINDS)
    trial = Trial(kind)
    happenings = tuple(ScriptedEvent(at_s=when, do=do) for when, do in _script(kind, rng, site))
    scenario = Scenario(
        name="attack", title="attack", about="attack", duration_s=60.0, events=happenings
    )
    engine = SlowEngine(_plans(kind, rng, site))
    engine.turns = rng.choice([0, 0, 3, 20])
    checked = kind in ("halted", "pre-empted", "workflow") or rng.random() < 0.3
    sim = Tapped(site, seed, scenario)
    station = open_station(
        site,
        engine.engine(),
        LiveClock(),
        scenario=LoadedScenario(scenario, "0" * 64),
        respond=True,
        variant=Variant(name="attack", rehearsal=rng.random() < 0.1, checks=checked, method="bm25"),
        fleet=SimulatedFleet(sim),
    )
    await _Drive(trial, rng, station, sim).run()
    return trial


class _Drive:
    """Gives the orders of one trial at their moments."""

    def __init__(
        self, trial: Trial, rng: random.Random, station: ControlStation, sim: Tapped
    ) -> None:
        self._trial, self._rng, self._station, self._sim = trial, rng, station, sim
        self._stop_tick = rng.randint(1, LATEST_TICK)
        self._into_plan = rng.randint(0, 60) if rng.random() < 0.5 else -1
        self._stop_event = rng.randint(3, 60) if rng.random() < 0.3 else 0
        self._again_tick = rng.randint(1, 60) if rng.random() < 0.2 else 0
        self._cancel_tick = rng.randint(1, self._stop_tick) if trial.kind == "cancelled" else 0
        self._later = rng.random() < 0.5
        self._stopped_tick = 0
        self._approve = standing_approver("auto")
        self._ordered = self._last_sent = 0.0
        sim.on_send, sim.on_step = self._sent, self._stepped

    async def run(self) -> None:
        """Give the missions and go on until some time after the stop."""
        missions = {"idle": 0, "queue": 3, "workflow": 0}.get(self._trial.kind, 1)
        for number in range(missions):
            self._station.submit(f"Mission {number}: send a drone somewhere.")
        count = 0
        async with aclosing(self._station.run()) as events:
            async for event in events:
                self._trial.events.append(event)
                count += 1
                if isinstance(event.data, ev.ApprovalRequested):
                    with suppress(ValueError):  # nothing waits any more
                        self._station.decide(self._approve(event.data))
                if count == self._stop_event and not self._stopped_tick:
                    self._stop()
                self._note(event)
                if self._stopped_tick and self._sim.tick > self._stopped_tick + AFTER_TICKS:
                    return

    def _note(self, event: ev.Event) -> None:
        arrived = isinstance(event.data, ev.MissionStarted | ev.MissionReceived)
        if arrived and self._stopped_tick and event.tick > self._stopped_tick:
            self._trial.started_after.append(f"{event.data.kind} {event.mission}")

    def _sent(self, command: DeviceCommand) -> None:
        self._last_sent = perf_counter()
        if self._into_plan >= 0 and not self._trial.before:
            self._stop_tick = self._sim.tick + 1 + self._into_plan
        (self._trial.after if self._stopped_tick else self._trial.before).append(command)

    def _stepped(self, tick: int) -> None:
        if tick == self._cancel_tick:
            self._order(self._station.cancel)
        if tick >= self._stop_tick and not self._stopped_tick:
            self._order(self._stop)
        if tick == self._again_tick and self._stopped_tick:
            self._order(self._station.stop_all)
        if self._stopped_tick and self._rng.random() < 0.05:
            self._try_anything()

    def _order(self, act: Callable[[], object]) -> None:
        """Do `act` within this step, or as a key does, at the event loop's next turn."""
        self._ordered = perf_counter()

        def attempt() -> None:
            with suppress(ValueError):
                act()

        if self._later:
            asyncio.get_running_loop().call_soon(attempt)
        else:
            attempt()

    def _stop(self) -> None:
        if self._stopped_tick:
            return
        if not self._ordered:
            self._ordered = perf_counter()
        self._stopped_tick = self._sim.tick
        self._again_tick += self._stopped_tick if self._again_tick else 0
        self._station.stop_all()
        self._trial.held_s.append(self._last_sent - self._ordered)

    def _try_anything(self) -> None:
        """Do what an operator who does not think of the stop might do."""
        station = self._station
        acts: list[Callable[[], object]] = [
            lambda: station.submit("Send Drone_T04 to the West Gate."),
            station.cancel,
            lambda: station.inject(FailAsset(asset="Drone_T02")),
            lambda: station.inject(SetRadio()),
        ]
        with suppress(ValueError):
            self._rng.choice(acts)()


@dataclass
class Tally:
    """What many trials came to."""

    trials: int = 0
    held: int = 0
    """Holds that left after a stop."""
    moved_after: Counter[str] = field(default_factory=Counter[str])
    undecided: Counter[str] = field(default_factory=Counter[str])
    started_after: int = 0
    amiss: list[int] = field(default_factory=list[int])
    """Seeds of trials in which something left that must not."""
    held_s: list[float] = field(default_factory=list[float])

    def take(self, seed: int, trial: Trial) -> None:
        """Add one trial."""
        self.trials += 1
        self.held += sum(command.verb == "hold" for command in trial.after)
        self.moved_after.update(trial.moved_after)
        self.undecided.update(trial.undecided)
        self.started_after += len(trial.started_after)
        self.held_s += trial.held_s
        if trial.moved_after or trial.undecided or trial.started_after:
            self.amiss.append(seed)

    def add(self, other: "Tally") -> None:
        """Add the trials of another process."""
        for name in ("trials", "held", "moved_after", "undecided", "started_after", "amiss",
                     "held_s"):  # fmt: skip
            setattr(self, name, getattr(self, name) + getattr(other, name))

    def summary(self) -> str:
        """Return everything in words."""
        return (
            f"{self.trials} missions stopped; commands that move an asset after the stop: "
            f"{dict(self.moved_after)}; that nobody decided: {dict(self.undecided)}; missions that "
            f"arrived or began after the stop: {self.started_after}; seeds with something amiss: "
            f"{self.amiss[:20]}; from the order to stop to the last hold at most "
            f"{1000 * max(self.held_s, default=0.0):.2f} ms"
        )


async def stops(first: int, count: int) -> Tally:
    """Return what the trials with `count` seeds from `first` come to."""
    tally = Tally()
    for seed in range(first, first + count):
        tally.take(seed, await stop_at_random(seed))
    return tally


def _chunk(first: int) -> Tally:
    return asyncio.run(stops(first, CHUNK))


def campaign(count: int, seed: int) -> tuple[list[str], list[str]]:
    """Stop so many missions, on all cores; return what came of them and what was amiss."""
    tally = Tally()
    with ProcessPoolExecutor() as pool:
        for part in pool.map(_chunk, range(seed, seed + count, CHUNK)):
            tally.add(part)
    return [tally.summary()], [f"seed {number}" for number in tally.amiss]
