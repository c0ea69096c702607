"""Data sets are made group by group; a mission of a test set never gets in."""

from collections import Counter
from dataclasses import replace

import pytest
from pa_training.phrasing.rewording import COMBINED
from pa_training.samples.planner_samples import Recipe, make_group

from pa_console.evaluation.jobs import load_missions
from pa_console.policy.rulebook import load_rules
from pa_console.resources import find_data
from pa_training.samples.data_set import Job, Made, build, drop_known
from pa_training.situations.worlds import shipped_missions, shipped_world

RULES = find_data("rules", "checkpoint", "rules.yaml")


def made_of(job: Job) -> Made:
    """Return what the only group of `job` is."""
    groups: list[Made] = []
    build([job], RULES, 1, lambda _, made: groups.append(made))
    [made] = groups
    return made


@pytest.fixture(scope="module")
def both() -> Made:
    return made_of(Job(Recipe(3, seed=5, missions=2), ("planner", "judge")))


def test_a_group_has_samples_of_every_task(both: Made) -> None:
    tasks = [sample.task for sample in both.samples]
    assert tasks.count("planner") == 2
    assert {"planner", "judge"} <= set(tasks)
    worded_again = tasks.count("judge")
    assert both.near.checked in range(2, 2 + worded_again + 1)
    assert both.near.dropped == 0


def test_a_mission_in_other_words_asks_for_the_same() -> None:
    said = made_of(Job(Recipe(3, seed=5, missions=2, wordings=4), ("planner",))).samples
    once = made_of(Job(Recipe(3, seed=5, missions=2), ("planner",))).samples
    assert 4 <= len(said) <= 8
    assert len({sample.rest for sample in said}) > len(once)
    assert {sample.answer for sample in said} == {sample.answer for sample in once}


def test_what_asks_for_several_things_is_worded_most_often() -> None:
    recipe = Recipe(0, seed=5, missions=8)
    missions = Counter(s.answer for s in made_of(Job(recipe, ("planner",))).samples)
    said = made_of(Job(recipe._replace(wordings=2), ("planner",))).samples
    wordings = Counter(sample.answer for sample in said)
    several = {sample.answer for sample in said if sample.kind.startswith(COMBINED)}
    assert any(wordings[answer] > 2 * missions[answer] for answer in several)
    assert all(wordings[answer] <= 2 * missions[answer] for answer in missions.keys() - several)


def test_one_part_alone_is_what_it_is_in_both(both: Made) -> None:
    planner = made_of(Job(Recipe(3, seed=5, missions=2), ("planner",)))
    assert planner.samples == [sample for sample in both.samples if sample.task == "planner"]


def test_a_mission_of_a_test_set_is_dropped_and_counted() -> None:
    paper = next(path for path in shipped_missions() if path.stem == "paper")
    [known, *_] = load_missions(paper, shipped_world()).missions
    group = make_group(Recipe(3, seed=5, missions=2), load_rules(RULES), frozenset())
    kept = group.proven[1]
    case = group.proven[0].case.model_copy(update={"command": f"Hello, {known.command}"})
    group.proven[0] = replace(group.proven[0], case=case)
    near = drop_known(group)
    assert group.proven == [kept]
    assert group.dropped["near duplicate"] == near.dropped == 1
    assert near.checked == 2
