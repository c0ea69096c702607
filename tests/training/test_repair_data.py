"""Repair samples: what is sent back has the faults that are named, and the answer mends them."""

import json
import random
from functools import cache

from pa_console.llm.reading import read_reason
from pa_console.policy.retriever import Retriever
from pa_console.policy.rulebook import Rulebook, load_rules
from pa_console.resources import data_folder
from pa_console.schema.plan import Plan
from pa_console.training.planner_data import Group, Recipe, make_group
from pa_console.training.repair_data import faults_of, repair_samples
from pa_console.training.samples import Sample


@cache
def rulebook() -> Rulebook:
    return load_rules(data_folder() / "rules" / "checkpoint.yaml")


@cache
def group() -> Group:
    return make_group(Recipe(1, seed=4, missions=6), rulebook(), frozenset())


def samples(seed: int) -> list[Sample]:
    retriever = Retriever(rulebook().rules)
    return list(repair_samples(group(), rulebook(), retriever, random.Random(seed)))


def told(sample: Sample) -> tuple[Plan, list[str]]:
    """Return the answer that `sample` says was sent back, and for what."""
    _, _, previous = sample.rest.partition("\nPrevious answer: ")
    answer, *wrong = previous.split("\n")
    return Plan.model_validate_json(answer), [line.removeprefix("Wrong: ") for line in wrong]


def test_the_faults_of_what_is_sent_back_are_its_own_and_the_answer_has_none() -> None:
    found = [sample for seed in range(3) for sample in samples(seed)]
    assert found
    for sample in found:
        plan, wrong = told(sample)
        right = Plan.model_validate_json(sample.answer)
        proven = next(p for p in group().proven if p.plan == right)
        faults = faults_of(proven, plan, group().situation, rulebook())
        assert wrong == [" ".join(fault.split()) for fault in faults]
        assert wrong
        assert faults_of(proven, right, group().situation, rulebook()) == ()


def test_what_was_asked_is_mostly_the_same_in_both() -> None:
    found = [sample for seed in range(6) for sample in samples(seed)]
    asked = [
        (read_reason(told(sample)[0].reason), read_reason(json.loads(sample.answer)["reason"]))
        for sample in found
    ]
    assert sum(sent == right for sent, right in asked) > len(asked) / 2


def test_equal_seeds_give_equal_samples() -> None:
    assert samples(1) == samples(1)
