"""The shipped missions can succeed, not by doing nothing, and by more than one plan."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.evaluation.runner import enforced_rules
from pa_console.evaluation.score import begin, idle_run
from pa_console.policy.rulebook import load_rules
from pa_console.resources import data_folder
from pa_console.schema.evaluation import MissionCase
from pa_training.proof.playing import words_findings
from tests.evaluation.plan_play import play, safeguards
from tests.evaluation.witness_play import plans, written
from tests.shipped import missions

pytestmark = pytest.mark.long

RULES = load_rules(data_folder() / "rules" / "checkpoint.yaml")
ENFORCED = enforced_rules(RULES)
CASES = missions()
Other = tuple[str, list[str]]
WITNESSES = written("*.yaml")
OTHERS: list[Other] = [
    (name, lines) for name, several in written("others/*.yaml").items() for lines in several
]
WRONG: list[Other] = [
    (name, lines) for name, several in written("wrong/*.yaml").items() for lines in several
]
TO_DO = ("execute", "trim")
SAMPLE = 40
SHORT_S = 20.0
"""Runs are watched so long at least, not their own time: what a plan does lasts as long as it."""


def short(case: MissionCase) -> MissionCase:
    """Return the mission, watched for SHORT_S at least instead of its own time."""
    return case.model_copy(update={"watch_s": SHORT_S})


def test_every_mission_that_is_to_be_carried_out_has_a_witness() -> None:
    to_do = {name for name, (case, _) in CASES.items() if case.expect in TO_DO}
    assert to_do <= set(WITNESSES) <= set(CASES)
    assert {name for name, _ in [*OTHERS, *WRONG]} <= set(CASES)


def test_nothing_that_is_to_be_carried_out_is_refused_for_its_words() -> None:
    to_do = [found for found in CASES.values() if found[0].expect in TO_DO]
    assert not [case.id for case, world in to_do if words_findings(world, case, RULES)]


@pytest.mark.parametrize("name", sorted(WITNESSES))
def test_a_plan_carries_it_out_that_the_safeguards_admit(name: str) -> None:
    case, world = CASES[name]
    objects = safeguards(case, RULES)
    todo = plans(WITNESSES[name])
    scored, against = play(short(case), begin(case, world, 0), ENFORCED, todo, objects)
    assert (against, scored.failed, scored.broken) == ([], (), ())
    assert scored.strict


@pytest.mark.parametrize("name", sorted(CASES))
def test_doing_nothing_is_success_only_where_that_is_right(name: str) -> None:
    case, world = CASES[name]
    assert case.success
    scored = idle_run(short(case), world, 0, ENFORCED)
    assert scored.strict == (case.expect not in TO_DO)


@settings(max_examples=SAMPLE, deadline=None)
@given(st.sampled_from(OTHERS))
def test_another_plan_that_an_operator_would_take_succeeds_too(other: Other) -> None:
    name, lines = other
    case, world = CASES[name]
    objects = safeguards(case, RULES)
    scored, against = play(short(case), begin(case, world, 0), ENFORCED, plans(lines), objects)
    assert (against, scored.failed, scored.broken) == ([], (), ())


@settings(max_examples=SAMPLE, deadline=None)
@given(st.sampled_from(WRONG))
def test_a_plan_that_no_operator_would_take_fails(other: Other) -> None:
    name, lines = other
    case, world = CASES[name]
    scored, _ = play(short(case), begin(case, world, 0), ENFORCED, plans(lines))
    assert not scored.strict
