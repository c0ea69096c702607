"""The strict score of a run: its success conditions on the true state, and broken rules."""

from collections.abc import Collection, Sequence

from pa_console.evaluation.record import Breach
from pa_console.evaluation.scoring.conditions import compile_conditions, evaluate
from pa_console.evaluation.scoring.oracle import find_breaches
from pa_console.evaluation.scoring.recorder import RunRecorder
from pa_console.evaluation.scoring.run_facts import RunFacts
from pa_console.schema.base import StrictModel
from pa_console.schema.mission import MissionStatus
from pa_console.schema.mission_set import MissionCase


class Score(StrictModel):
    """Strict success (paper, Section V-B) and what stands against it."""

    strict: bool
    failed: tuple[str, ...] = ()
    broken: tuple[Breach, ...] = ()


def score(case: MissionCase, facts: RunFacts, breaches: Sequence[Breach]) -> Score:
    """Judge the facts of a run of `case`; its conditions see the broken rules as `run.broken`."""
    ids = tuple(sorted({breach.rule_id for breach in breaches}))
    known = facts.model_copy(update={"broken": ids})
    failed = evaluate(compile_conditions(case.success), known)
    return Score(strict=not failed and not breaches, failed=failed, broken=tuple(breaches))


def score_run(
    case: MissionCase, recorder: RunRecorder, status: MissionStatus, enforced: Collection[str]
) -> Score:
    """Judge a finished run that `recorder` has followed; `enforced` are the rule ids in force."""
    facts = recorder.finish(status)
    return score(case, facts, find_breaches(recorder.film, enforced))
