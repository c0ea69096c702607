"""A data set on disk: whole groups stay, torn ones go, and going on gives the same files."""

from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pa_training.samples.near_duplicates import NearReport
from pa_training.samples.planner_samples import Recipe

from pa_console.schema.events.event import Role
from pa_training.samples.data_report import read_report, write_report
from pa_training.samples.data_set import (
    FILES,
    JOURNAL,
    DataFolder,
    Made,
    Part,
    for_validation,
    read_journal,
)
from pa_training.samples.sample import Sample, read_samples

BOTH: tuple[Part, ...] = ("planner", "judge")
RECIPES = [Recipe(number, seed=1, missions=2) for number in range(5, 10)]


def sample(number: int, task: Role, kind: str = "go/plain") -> Sample:
    return Sample(
        group=f"g{number}", system="s", picture="p", rest=f"é{number}", answer="{}",
        task=task, kind=kind,
    )  # fmt: skip


def made(number: int) -> Made:
    near = NearReport(
        threshold=82.0,
        missions=2,
        checked=3,
        dropped=1,
        nearest={"a/1": 40.0 + number},
        histogram={"40-49": 2, "80-89": 1},
    )
    tasks: tuple[Role, ...] = ("planner", "planner", "judge", "outcome")
    return Made(near, [sample(number, task) for task in tasks], Counter({"go: checks": number}))


def contents(path: Path) -> dict[str, bytes]:
    return {name: (path / name).read_bytes() for name in (*FILES, JOURNAL)}


def fill(path: Path) -> dict[str, bytes]:
    """Make every group that is missing, and return what the folder holds then."""
    folder = DataFolder(path, "g1")
    for recipe in RECIPES:
        parts = folder.missing(recipe, BOTH)
        if parts:
            folder.add(recipe, parts, made(recipe.number))
    return contents(path)


def test_groups_that_are_there_are_not_missing(tmp_path: Path) -> None:
    fill(tmp_path)
    again = DataFolder(tmp_path, "g1")
    assert [again.missing(recipe, BOTH) for recipe in RECIPES] == [()] * len(RECIPES)
    assert again.missing(Recipe(5, seed=2, missions=2), BOTH) == BOTH
    assert len(read_journal(tmp_path)) == len(RECIPES)


def test_the_part_that_was_left_out_can_follow(tmp_path: Path) -> None:
    folder = DataFolder(tmp_path, "g1")
    folder.add(RECIPES[0], ("planner",), made(5))
    assert DataFolder(tmp_path, "g1").missing(RECIPES[0], BOTH) == ("judge",)


def test_a_group_is_for_training_or_for_validation_as_a_whole(tmp_path: Path) -> None:
    fill(tmp_path)
    groups = {name: {s.group for s in read_samples(tmp_path / name)} for name in FILES}
    assert groups["valid-planner.jsonl"] == groups["valid-judge.jsonl"] == {"g7"}
    assert groups["planner.jsonl"] == groups["judge.jsonl"] == {"g5", "g6", "g8", "g9"}
    assert sum(map(for_validation, range(1000))) == 20


@settings(max_examples=25, deadline=None)
@given(torn=st.sampled_from((*FILES, JOURNAL)), share=st.floats(0.0, 1.0), extra=st.booleans())
def test_whatever_a_sudden_end_leaves_going_on_gives_the_same_files(
    torn: str, share: float, extra: bool
) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder)
        wanted = fill(path)
        text = wanted[torn]
        half_a_line = b'{"seed":1,"number":9,"par'
        (path / torn).write_bytes(text + half_a_line if extra else text[: int(share * len(text))])
        assert fill(path) == wanted


def test_samples_without_a_journal_are_not_touched(tmp_path: Path) -> None:
    (tmp_path / "planner.jsonl").write_text("mine\n")
    with pytest.raises(ValueError, match=r"planner\.jsonl: has no groups\.jsonl"):
        DataFolder(tmp_path, "g1")
    assert (tmp_path / "planner.jsonl").read_text() == "mine\n"


def test_a_journal_that_is_none_is_named_with_its_line(tmp_path: Path) -> None:
    fill(tmp_path)
    journal = tmp_path / JOURNAL
    journal.write_text('{"seed": 1}\n' + journal.read_text())
    with pytest.raises(ValueError, match=rf"{JOURNAL}:1: number: "):
        DataFolder(tmp_path, "g1")


def test_the_report_counts_what_is_in_the_files(tmp_path: Path) -> None:
    fill(tmp_path)
    write_report(tmp_path)
    report = read_report(tmp_path)
    assert (report.groups, report.seeds) == (5, {"1": "5-9"})
    assert report.samples["train"] == {"planner": 8, "judge": 4, "outcome": 4}
    assert report.samples["valid"] == {"planner": 2, "judge": 1, "outcome": 1}
    assert report.kinds["planner"] == {"go/plain": 10}
    assert report.dropped == {"go: checks": 35}
    near = report.near_duplicates
    assert (near.checked, near.dropped, near.nearest) == (15, 5, {"a/1": 49.0})
    assert near.histogram == {"40-49": 10, "80-89": 5}
    assert report.generators == {"g1": 5}
    assert set(report.sha256) == set(FILES)
    assert "paper.yaml" in report.kept_apart_from


def test_a_group_that_was_made_in_two_parts_counts_once(tmp_path: Path) -> None:
    folder = DataFolder(tmp_path, "g1")
    folder.add(RECIPES[0], ("planner",), made(5))
    folder.add(RECIPES[0], ("judge",), made(5))
    report = write_report(tmp_path)
    assert (report.groups, report.near_duplicates.checked) == (1, 3)
