"""Plays given plans in the simulation, with or without the safeguards, for the strict scorer."""

import asyncio
from collections.abc import Callable, Sequence

from pa_console.evaluation.score import RunRecorder, Score, score_run, watch
from pa_console.mission.examine import examine
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.evaluation import MissionCase
from pa_console.schema.plan import Plan
from pa_console.sim.checkpoint import Checkpoint
from pa_training.proof.playing import carry_out, mission_of

PATIENCE_S = 12
"""So long the next of several plans may take to become admissible, simulated seconds."""

Objects = Callable[[Checkpoint, Plan], list[str]]
"""What keeps everybody from approving a plan now."""


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
    watch(sim, recorder, case.watch_s - recorder.recording.final.time_s)
    return score_run(case, recorder, "verified", enforced), against
