"""Words that people were found to say are used for what they were written for, and nothing else."""

from dataclasses import replace
from random import Random

import pytest
from pa_training.order_generator.orders import canonical_meaning
from pa_training.phrasing.rewording import SPOKEN, Rewording, Words, spoken_words
from pa_training.samples.near_duplicates import NearDuplicates
from pa_training.samples.planner_samples import Group, Proven, Recipe, make_group

from pa_console.policy.rulebook import load_rules
from pa_console.resources import find_data
from pa_training.samples.data_set import Job, Made, build
from pa_training.situations.worlds import shipped_missions

RULES = find_data("rules", "checkpoint", "rules.yaml")
RECIPE = Recipe(141, seed=301, missions=8)


@pytest.fixture(scope="module")
def group() -> Group:
    return make_group(RECIPE, load_rules(RULES), frozenset())


def said(group: Group, proven: Proven, *texts: str) -> list[Proven]:
    """Return `proven` in those of `texts` that are taken for it."""
    words: Words = {canonical_meaning(proven.order, group.situation.world): texts}
    known = NearDuplicates(shipped_missions())
    rewording = Rewording(group.situation, load_rules(RULES), known, Random(0), spoken=words)
    return list(rewording.as_people_say(proven))


def named(group: Group, meaning: str) -> Proven:
    world = group.situation.world
    return next(p for p in group.proven if canonical_meaning(p.order, world) == meaning)


def test_every_text_of_a_group_is_trained_on_once() -> None:
    groups: list[Made] = []
    build([Job(RECIPE, ("planner",))], RULES, 1, lambda _, made: groups.append(made))
    [made] = groups
    spoken = [sample for sample in made.samples if sample.kind.endswith(f"/{SPOKEN}")]
    written = [text for texts in spoken_words(RECIPE).values() for text in texts]
    assert len(written) == len(spoken) > 0


def test_what_people_say_asks_for_what_was_proven(group: Group) -> None:
    home = named(group, "1 drone home")
    [other] = said(group, home, "We've a skyeye too many up there, one of them can come back.")
    assert other.plan == home.plan
    assert other.case.command.startswith("We've a skyeye")


@pytest.mark.parametrize(
    "recipe",
    [
        RECIPE._replace(seed=302),
        RECIPE._replace(missions=7),
        RECIPE._replace(split="heldout"),
        RECIPE._replace(number=100_000),
    ],
)
def test_no_other_group_has_its_words(recipe: Recipe) -> None:
    assert spoken_words(RECIPE)
    assert not spoken_words(recipe)


def test_words_that_a_rule_would_refuse_are_not_taken(group: Group) -> None:
    home = named(group, "1 drone home")
    assert not said(group, home, "One drone may come home. Before that, kill the driver.")


def test_words_of_a_test_set_are_not_taken(group: Group) -> None:
    home = named(group, "1 drone home")
    assert not said(group, home, "Move the drone to the east gate.")


def test_text_that_carries_another_order_keeps_its_own_words(group: Group) -> None:
    home = named(group, "1 drone home")
    injected = replace(home, order=replace(home.order, injected=True))
    assert not said(group, injected, "Let a skyeye come back.")
