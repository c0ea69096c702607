"""Plays plans in the simulation without any model, for the strict scorer to judge."""

from collections.abc import Callable
from datetime import UTC, datetime

from pa_console.evaluation.score import RunRecorder
from pa_console.mission.execution.dispatch import Dispatch
from pa_console.mission.rehearse import device_commands
from pa_console.policy.rule_checks import check_mission
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.evaluation import MissionCase
from pa_console.schema.finding import Finding
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Plan
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint

LIMIT_S = 240.0
"""A command that has not ended by then is left behind."""

Look = Callable[[Dispatch], bool]
"""Looks at every new picture while a plan is carried out; False gives the plan up."""


def mission_from(text: str) -> Mission:
    """Return the mission that an operator gives by the words `text`."""
    return Mission(id="M", text=text, created=datetime(2026, 1, 1, tzinfo=UTC))


def mission_of(case: MissionCase) -> Mission:
    """Return the mission that an operator gives by the words of `case`."""
    return mission_from(case.command)


def words_findings(world: World, case: MissionCase, rulebook: Rulebook) -> tuple[Finding, ...]:
    """Return the findings that refuse the mission for its words alone."""
    return tuple(f for f in check_mission(rulebook, mission_of(case), world) if f.blocking)


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
