"""A data set: groups of samples that are whole or not there, and files put together from them."""

import json
from pathlib import Path

import pytest

from pa_console.language.name_linking import link_names
from pa_console.policy.rulebook import load_rules
from pa_console.resources import find_data
from pa_console.schema.events.event import Role
from pa_training.samples.data_report import read_report, write_report
from pa_training.samples.data_set import FILES, GROUPS, DataFolder, Made, build
from pa_training.samples.groups import Recipe, make_group, recipes
from pa_training.samples.sample import Sample, read_samples

RULES = find_data("rules", "checkpoint", "rules.yaml")
RECIPE = next(recipes("development"))._replace(plans=2)


def made(name: str, valid: bool = False) -> Made:
    tasks: tuple[Role, ...] = ("planner", "planner", "judge", "outcome")
    samples = tuple(
        Sample(group=name, system="s", picture="p", rest=f"é{n}", answer="{}", task=task, kind="go")
        for n, task in enumerate(tasks)
    )
    return Made(name=name, valid=valid, generator="g1", samples=samples, dropped={"go": 2})


@pytest.fixture
def folder(tmp_path: Path) -> DataFolder:
    data = DataFolder(tmp_path)
    for name in "abc":
        data.add(made(name, valid=name == "b"))
    return data


def test_a_group_is_for_training_or_for_validation_as_a_whole(folder: DataFolder) -> None:
    folder.put_together()
    groups = {name: {s.group for s in read_samples(folder.path / name)} for name in FILES}
    assert groups["planner.jsonl"] == groups["judge.jsonl"] == {"a", "c"}
    assert groups["valid-planner.jsonl"] == groups["valid-judge.jsonl"] == {"b"}


def test_a_group_that_a_sudden_end_has_torn_is_not_there(tmp_path: Path) -> None:
    data = DataFolder(tmp_path)
    recipe = Recipe("written", "somebody", 0)
    (tmp_path / GROUPS / f"{recipe.name}.partial").write_text('{"name": "g')
    assert recipe not in data
    data.add(made(recipe.name))
    assert recipe in data
    assert [group.name for group in data.groups()] == [recipe.name]


def test_samples_without_groups_are_not_touched(tmp_path: Path) -> None:
    (tmp_path / "planner.jsonl").write_text("mine\n")
    with pytest.raises(ValueError, match=r"planner\.jsonl: has no groups beside it"):
        DataFolder(tmp_path)
    assert (tmp_path / "planner.jsonl").read_text() == "mine\n"


def test_a_group_that_cannot_be_read_is_named(folder: DataFolder) -> None:
    (folder.path / GROUPS / "b.json").write_text('{"name": 1}')
    with pytest.raises(ValueError, match=r"b\.json: name: "):
        folder.put_together()


def test_the_report_counts_what_is_in_the_files(folder: DataFolder) -> None:
    write_report(folder.path)
    report = read_report(folder.path)
    assert report.groups == 3
    assert report.samples["train"] == {"planner": 4, "judge": 2, "outcome": 2}
    assert report.samples["valid"] == {"planner": 2, "judge": 1, "outcome": 1}
    assert report.kinds["planner"] == {"go": 6}
    assert report.dropped == {"go": 6}
    assert report.generators == {"g1": 3}
    assert set(report.sha256) == set(FILES)
    assert "paper.yaml" in report.kept_apart_from


def test_a_group_has_readings_plans_and_verdicts() -> None:
    [group] = build([RECIPE], RULES, "g1", 1)
    planner = [sample for sample in group.samples if sample.task == "planner"]
    whole = [sample for sample in planner if not sample.goes_on and "actions" in sample.answer]
    plans = [sample for sample in whole if json.loads(sample.answer)["actions"]]
    assert len(plans) == 2
    assert len(planner) > 10
    assert {sample.task for sample in group.samples} >= {"planner", "judge"}
    assert group.valid
    assert list(build([RECIPE], RULES, "g1", 1)) == [group]


def test_at_another_moment_only_orders_that_name_their_assets_are_given() -> None:
    later = RECIPE._replace(round=1)
    group = make_group(later, load_rules(RULES), frozenset())
    seen = make_group(RECIPE, load_rules(RULES), frozenset())
    assert group.situation.world == seen.situation.world
    assert group.situation.picture != seen.situation.picture
    assert group.proven
    for proven in group.proven:
        words = link_names(group.situation.world, proven.case.command)
        assert all(name in words for name in proven.order.named)
    [made_later] = build([later], RULES, "g1", 1)
    assert not any(sample.goes_on for sample in made_later.samples)
