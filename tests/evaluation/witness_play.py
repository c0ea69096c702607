"""Plays plans written by hand in the simulation, without any model, for the scorer to judge."""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import yaml

from pa_console.evaluation.scoring.idle import begin, watch
from pa_console.evaluation.scoring.recorder import RunRecorder
from pa_console.evaluation.scoring.score import Score, score_run
from pa_console.orchestrator.dispatch import Dispatch
from pa_console.orchestrator.rehearsal import device_commands
from pa_console.orchestrator.safeguards import examine
from pa_console.policy.checks import check_mission
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.mission import Mission
from pa_console.schema.mission_set import MissionCase
from pa_console.schema.plan import Action, Plan
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint

PATIENCE_S = 12
"""So long the next of several plans may take to become admissible, simulated seconds."""
LIMIT_S = 240.0
FOLDER = Path(__file__).parent / "witnesses"

Objects = Callable[[Checkpoint, Plan], list[str]]
"""What keeps everybody from approving a plan now."""


def written(pattern: str) -> Mapping[str, Any]:
    """Return what the witness files that match `pattern` say, by mission id."""
    found: dict[str, Any] = {}
    for path in sorted(FOLDER.glob(pattern)):
        found |= yaml.safe_load(path.read_text(encoding="utf-8")) or {}
    return found


def plans(lines: Sequence[str] | Sequence[Sequence[str]]) -> list[Plan]:
    """Return the plans of a witness: one, from `agent command` lines, or one after another."""
    several = [lines] if all(isinstance(line, str) for line in lines) else lines
    return [
        Plan(
            reason="written by hand",
            actions=tuple(
                Action(agent=agent, command=command)
                for agent, _, command in (str(line).partition(" ") for line in one)
            ),
        )
        for one in several
    ]


def words_refused(world: World, case: MissionCase, rulebook: Rulebook) -> list[str]:
    """Return the rules that refuse the mission for its words alone."""
    return [f.rule_id for f in check_mission(rulebook, _mission(case), world) if f.blocking]


def safeguards(case: MissionCase, rulebook: Rulebook) -> Objects:
    """Return the console's own objections to plans for `case`."""

    def objects(sim: Checkpoint, plan: Plan) -> list[str]:
        findings = asyncio.run(examine(plan, _mission(case), sim, rulebook)).findings
        return [f"{f.rule_id}: {f.message}" for f in findings if f.blocking]

    return objects


def anything_goes(_sim: Checkpoint, _plan: Plan) -> list[str]:
    """Return no objection at all."""
    return []


def play(
    case: MissionCase,
    world: World,
    enforced: frozenset[str],
    todo: Sequence[Plan],
    objects: Objects = anything_goes,
) -> tuple[Score, list[str]]:
    """Carry out the plans one after another; return the score and what is objected to a plan.

    Each waits until nothing is objected to it, at most PATIENCE_S. The first that stays
    inadmissible is not carried out, nor is what follows.
    """
    sim = begin(case, world, 0)
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
        _carry_out(sim, recorder, plan, f"plan{number}")
    watch(sim, recorder, case.watch_s - recorder.film.final.time_s)
    return score_run(case, recorder, "verified", enforced), against


def _carry_out(sim: Checkpoint, recorder: RunRecorder, plan: Plan, prefix: str) -> None:
    """Send the plan's commands, again where no answer comes, and step until each has ended."""
    commands = device_commands(plan, prefix)
    dispatch = Dispatch(commands, sim.tick, sim.world.dt_s, LIMIT_S)
    for command in commands:
        recorder.sent(command)
        sim.send(command)
    every = max(1, round(sim.world.telemetry_period_s / sim.world.dt_s))
    while not dispatch.finished:
        for reply in dispatch.advance(sim.tick, sim.step()):
            recorder.replied(reply)
        for command, _ in dispatch.resends(sim.tick):
            sim.send(command)
        if sim.tick % every == 0:
            recorder.sample()


def _mission(case: MissionCase) -> Mission:
    return Mission(id="M", text=case.command, created=datetime(2026, 1, 1, tzinfo=UTC))
