"""Plays plans in the simulation without any model, for the strict scorer to judge."""

import asyncio
from collections.abc import Callable, Sequence
from datetime import UTC, datetime

from pa_console.evaluation.scoring.idle_run import watch
from pa_console.evaluation.scoring.score import RunRecorder, Score, score_run
from pa_console.orchestrator.execution.dispatch import Dispatch
from pa_console.orchestrator.planning.rehearsal import device_commands
from pa_console.orchestrator.planning.safeguards import examine
from pa_console.policy.checks.rule_checks import check_mission
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.evaluation import MissionCase
from pa_console.schema.finding import Finding
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Plan
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint

PATIENCE_S = 12
"""So long the next of several plans may take to become admissible, simulated seconds."""
LIMIT_S = 240.0
"""A command that has not ended by then is left behind."""

Objects = Callable[[Checkpoint, Plan], list[str]]
"""What keeps everybody from approving a plan now."""

Look = Callable[[Dispatch], bool]
"""Looks at every new picture while a plan is carried out; False gives the plan up."""


def mission_of(case: MissionCase) -> Mission:
    """Return the mission that an operator gives by the words of `case`."""
    return Mission(id="M", text=case.command, created=datetime(2026, 1, 1, tzinfo=UTC))


def words_findings(world: World, case: MissionCase, rulebook: Rulebook) -> tuple[Finding, ...]:
    """Return the findings that refuse the mission for its words alone."""
    return tuple(f for f in check_mission(rulebook, mission_of(case), world) if f.blocking)


def safeguards(case: MissionCase, rulebook: Rulebook) -> Objects:
    """Return the console's own objections to plans for `case`."""

    def objects(sim: Checkpoint, plan: Plan) -> list[str]:
        findings = asyncio.run(examine(plan, mission_of(case), sim, rulebook)).findings
        return [f"{f.rule_id}: {f.message}" for f in findings if f.blocking]

    return objects


def anything_goes(_sim: Checkpoint, _plan: Plan) -> list[str]:
    """Return no objection at all."""
    return []


def play(
    case: MissionCase,
    sim: Checkpoint,
    enforced: frozenset[str],
    todo: Sequence[Plan],
    objects: Objects = anything_goes,
) -> tuple[Score, list[str]]:
    """Carry out the plans one after another; return the score and what is objected to a plan.

    `sim` is as it is when the command is given; it is stepped. Each plan waits until nothing is
    objected to it, at most PATIENCE_S. The first that stays inadmissible is not carried out, nor
    is what follows.
    """
    recorder = RunRecorder(sim, case.command)
    against: list[str] = []
    for number, plan in enumerate(todo):
        against = objects(sim, plan)
        for _ in range(PATIENCE_S if number else 0):
            if against:
                watch(sim, recorder, 1.0)
                against = objects(sim, plan)
        if against:
            break
        carry_out(sim, recorder, plan, f"plan{number}")
    watch(sim, recorder, case.watch_s - recorder.film.final.time_s)
    return score_run(case, recorder, "verified", enforced), against


def carry_out(  # noqa: PLR0917
    sim: Checkpoint,
    recorder: RunRecorder,
    plan: Plan,
    prefix: str,
    limit_s: float = LIMIT_S,
    look: Look | None = None,
) -> Dispatch:
    """Send the plan's commands, again where no answer comes, and step until each has ended.

    The truth is taken once a telemetry period, and `look` asked whether to go on.
    """
    commands = device_commands(plan, prefix)
    dispatch = Dispatch(commands, sim.tick, sim.world.dt_s, limit_s)
    for command in commands:
        recorder.sent(command)
        sim.send(command)
    every = telemetry_ticks(sim)
    while not dispatch.finished:
        for reply in dispatch.advance(sim.tick, sim.step()):
            recorder.replied(reply)
        for command, _ in dispatch.resends(sim.tick):
            sim.send(command)
        if sim.tick % every == 0:
            recorder.sample()
            if look is not None and not look(dispatch):
                break
    return dispatch


def telemetry_ticks(sim: Checkpoint) -> int:
    """Return how many steps a telemetry period takes."""
    return max(1, round(sim.world.telemetry_period_s / sim.world.dt_s))
