"""Judge samples: verdicts are true, readable, and follow from what the feedback says."""

import json
import random
from collections import Counter
from functools import cache
from itertools import groupby

import pytest

from pa_console.llm.roles.judge import read_verdict
from pa_console.policy.retriever import Retriever
from pa_console.policy.rulebook import Rulebook, load_rules
from pa_console.resources import data_folder
from pa_console.schema.incident import FailAsset
from pa_console.schema.plan import Action, Plan
from pa_training.proof.verify import verify
from pa_training.samples.corrupted_plans import Hope, Variant, right_variants, wrong_variants
from pa_training.samples.groups import Group, Proven, prove
from pa_training.samples.judge_samples import Label, judge_samples, label_plan
from pa_training.samples.outcome_samples import label_outcome, outcome_samples
from pa_training.samples.sample import Sample
from pa_training.situations.situations import Situation, settled
from pa_training.situations.worlds import shipped_world

ORDERS = {
    "A drone to WestGate.": "1 drone to WestGate",
    "Shoot at whoever is at EastGate.": "use force at EastGate",
    "Robot_T01 and Ugv_T02 to NorthGate.": "Robot_T01, Ugv_T02 to NorthGate",
}


@cache
def rulebook() -> Rulebook:
    return load_rules(data_folder() / "rules" / "checkpoint.yaml")


@cache
def situation() -> Situation:
    return settled(shipped_world())


def proven(text: str) -> Proven:
    found = prove("m1", text, ORDERS[text], situation(), rulebook())
    assert isinstance(found, Proven), found
    return found


@cache
def group() -> Group:
    return Group("g", situation(), [proven(text) for text in ORDERS])


@cache
def samples() -> tuple[Sample, ...]:
    retriever = Retriever(rulebook().rules)
    return tuple(judge_samples(group(), rulebook(), retriever, random.Random(3)))


def plan(*texts: str) -> Plan:
    actions = [Action(agent=t.split()[0], command=t.partition(" ")[2]) for t in texts]
    return Plan(reason="r", actions=tuple(actions))


def labelled(text: str, made: Plan, hope: Hope = "wrong") -> Label | str:
    mission = next(p for p in group().proven if p.case.command == text)
    verified = verify(mission.case, situation(), made, rulebook())
    return label_plan(mission, situation(), Variant(made, hope, "test"), verified)


def test_answers_are_what_the_judge_may_write() -> None:
    for sample in samples():
        answer = json.loads(sample.answer)
        verdict, error = read_verdict(sample.answer, answer["violated"])
        assert verdict is not None, error
        assert json.dumps(answer) == sample.answer


def test_there_are_right_and_wrong_plans_for_every_mission() -> None:
    verdicts = Counter(json.loads(sample.answer)["verdict"] for sample in samples())
    assert verdicts["Success"] >= len(group().proven) - 1
    assert verdicts["Failure"] >= len(group().proven) - 1


def test_a_plan_that_is_not_what_was_asked_fails() -> None:
    for sample in samples():
        answer = json.loads(sample.answer)
        if not answer["feedback"].endswith("; it fits"):
            assert answer["verdict"] == "Failure"


def test_what_the_console_writes_is_not_learnt() -> None:
    for sample in samples():
        words = json.loads(sample.answer)["feedback"]
        assert words.endswith(f"; planned: {sample.given}")
        assert words.startswith("asked: ")


def test_feedback_begins_with_what_was_asked() -> None:
    for sample in samples():
        told = json.loads(sample.answer)["feedback"]
        assert told.removeprefix("asked: ").partition("; planned: ")[0] in ORDERS.values()


def test_no_plan_is_judged_twice_for_one_mission() -> None:
    for _, same in groupby(samples(), key=lambda s: s.rest):
        answers = [sample.answer for sample in same]
        assert len(answers) == len(set(answers))


def test_equal_seeds_give_equal_samples() -> None:
    retriever = Retriever(rulebook().rules)
    again = judge_samples(group(), rulebook(), retriever, random.Random(3))
    assert tuple(again) == samples()


@pytest.mark.parametrize(
    ("text", "made", "why"),
    [
        ("A drone to WestGate.", plan("Drone_T04 move_to EastGate"), "Drone_T04 not asked for"),
        ("A drone to WestGate.", plan("Ugv_T02 move_to WestGate"), "Ugv_T02 not asked for"),
        ("A drone to WestGate.", plan("Drone_T04 hold"), "0 of 1 drone to WestGate"),
        (
            "Robot_T01 and Ugv_T02 to NorthGate.",
            plan("Robot_T01 move_to NorthGate"),
            "Ugv_T02 is not sent to NorthGate",
        ),
    ],
)
def test_a_legal_plan_that_does_the_wrong_thing_fails(text: str, made: Plan, why: str) -> None:
    label = labelled(text, made)
    assert isinstance(label, Label)
    assert (label.right, label.verdict) == (False, "Failure")
    assert label.feedback.endswith(f"; {why}")
    assert "WF-03" not in label.violated


def test_a_plan_that_should_be_right_and_failed_by_accident_is_left_out() -> None:
    mission = group().proven[0]
    failed = FailAsset(asset=mission.plan.agents[0])
    verified = verify(mission.case, situation(), mission.plan, rulebook(), (failed,))
    target = Variant(mission.plan, "right", "target")
    assert label_plan(mission, situation(), target, verified) == "looks right and is wrong"


def test_a_gate_left_uncovered_is_named_with_its_rule() -> None:
    gate, guard = next(iter(situation().digest.sole_cover.items()))
    other = next(g for g in situation().world.gates if g != gate)
    label = labelled("A drone to WestGate.", plan(f"{guard} move_to {other}"), "unsafe")
    assert isinstance(label, Label)
    assert not label.right
    assert "WF-03" in label.violated


def test_variants_differ_from_the_plan_and_from_one_another() -> None:
    rng = random.Random(1)
    for mission in group().proven:
        for found in (
            right_variants(mission, situation(), rng),
            wrong_variants(mission, group().proven, situation(), rng),
        ):
            plans = [variant.plan.actions for variant in found]
            assert len(set(plans)) == len(plans)
            assert mission.plan.actions not in plans


def test_outcomes_of_good_and_bad_runs() -> None:
    found = list(outcome_samples(group(), rulebook(), random.Random(2)))
    assert found
    for sample in found:
        answer = json.loads(sample.answer)
        assert answer["violated"] == []
        assert (answer["verdict"] == "Success") == answer["feedback"].endswith("; done")
        assert sample.task == "outcome"


def test_a_guard_that_fails_meanwhile_makes_the_outcome_a_failure() -> None:
    mission = group().proven[0]
    gate, guard = next(
        (g, n)
        for g, n in situation().digest.sole_cover.items()
        if g != "WestGate" and n not in mission.plan.agents
    )
    verified = verify(
        mission.case, situation(), mission.plan, rulebook(), (FailAsset(asset=guard),)
    )
    label = label_outcome(mission, situation(), verified)
    assert isinstance(label, Label)
    assert not label.right
    assert label.feedback.endswith(f"; {gate} lost its cover")
