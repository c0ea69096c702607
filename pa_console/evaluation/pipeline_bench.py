"""Measures the deterministic parts: retrieval, checks, rehearsal, fork and simulation speed."""

import asyncio
from collections.abc import Callable
from datetime import UTC, datetime
from statistics import median
from time import perf_counter

from pa_console.orchestrator.compose import Site
from pa_console.orchestrator.rehearsal import rehearse
from pa_console.policy.checks import check_plan
from pa_console.policy.retriever import Retriever
from pa_console.schema.base import StrictModel
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Action, Plan
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint


class Timing(StrictModel):
    """Seconds of one operation: median and longest of `runs`."""

    name: str
    runs: int
    median_s: float
    longest_s: float


def bench_pipeline(site: Site, runs: int, done: Callable[[str], None]) -> list[Timing]:
    """Time every deterministic stage on `site`; `done` is told the name of each as it ends."""
    plan = _patrol(site.world)
    mission = Mission(id="bench", text="report the state of every gate", created=datetime.now(UTC))
    sim = Checkpoint(site.world, seed=0)
    retriever = Retriever(site.rulebook.rules)
    rehearsal = asyncio.run(rehearse(sim, plan))
    operations: dict[str, Callable[[], object]] = {
        f"retrieve top 3 of {len(site.rulebook.rules)} rules": lambda: retriever.retrieve(
            mission.text, 3
        ),
        f"check {len(site.rulebook.rules)} rules on a rehearsed plan": lambda: check_plan(
            site.rulebook, plan=plan, rehearsal=rehearsal, mission=mission, world=site.world
        ),
        f"rehearse a plan of {rehearsal.timeline.duration_s:.0f} s": lambda: asyncio.run(
            rehearse(sim, plan)
        ),
        "fork the simulation": sim.fork,
        "one telemetry picture": sim.picture,
        "simulate 60 s": lambda: _simulate(sim.fork(), 60.0),
    }
    timings: list[Timing] = []
    for name, operation in operations.items():
        timings.append(_time(name, operation, runs))
        done(name)
    return timings


def _patrol(world: World) -> Plan:
    """Send every asset that stands elsewhere to the first gate: a plan with much movement."""
    gate = world.gates[0]
    movers = [name for name, spec in world.assets.items() if spec.post != gate]
    actions = tuple(Action(agent=name, command=f"move_to {gate}") for name in movers)
    return Plan(reason="a plan with much movement", actions=actions)


def _simulate(sim: Checkpoint, seconds: float) -> None:
    for _ in range(round(seconds / sim.world.dt_s)):
        sim.step()


def _time(name: str, operation: Callable[[], object], runs: int) -> Timing:
    seconds: list[float] = []
    for _ in range(runs):
        started = perf_counter()
        operation()
        seconds.append(perf_counter() - started)
    return Timing(name=name, runs=runs, median_s=median(seconds), longest_s=max(seconds))
