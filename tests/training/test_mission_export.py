"""Generated mission sets: they load, their worlds lie beside them, plans for them exist."""

import dataclasses
from pathlib import Path
from typing import Any

import pytest
from pa_training.results.mission_export import Found, generated_missions, write_mission_set
from pa_training.samples.near_duplicates import NearDuplicates

from pa_console.evaluation.jobs import load_with_worlds
from pa_console.resources import find_data
from pa_console.schema.evaluation import MissionCase
from pa_training.results import mission_export
from pa_training.situations.situations import Situation, settled
from pa_training.situations.worlds import shipped_missions, shipped_world

RULES = find_data("rules", "checkpoint", "rules.yaml")
WANTED = 2


@pytest.fixture(scope="module")
def found() -> list[Found]:
    return list(generated_missions(WANTED, 9001, "heldout", RULES, 1))


def test_as_many_missions_as_were_asked_for(found: list[Found]) -> None:
    assert sum(len(part.cases) for part in found) == WANTED


def test_equal_arguments_give_equal_missions(found: list[Found]) -> None:
    [again] = generated_missions(1, 9001, "heldout", RULES, 1)
    assert (again.world, again.cases) == (found[0].world, found[0].cases[:1])


def test_no_order_is_taken_whose_tracks_are_elsewhere_under_another_seed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def moved(*given: Any, **named: Any) -> Situation:
        there = settled(*given, **named)
        tracks = {
            name: track.model_copy(update={"gate": "OtherGate"})
            for name, track in there.picture.tracks.items()
        }
        assert tracks
        picture = there.picture.model_copy(update={"tracks": tracks})
        return dataclasses.replace(there, picture=picture)

    monkeypatch.setattr(mission_export, "settled", moved)
    monkeypatch.setattr(mission_export, "MOST_FRUITLESS", 1)
    with pytest.raises(ValueError, match="no mission"):
        list(generated_missions(1, 9001, "heldout", RULES, 1))


def test_a_written_set_reads_back_equal_with_its_worlds(found: list[Found], tmp_path: Path) -> None:
    file = tmp_path / "made.yaml"
    written = write_mission_set(file, "made", "a test", found)
    read, worlds = load_with_worlds(file, shipped_world())
    assert read == written
    cases = [case for part in found for case in part.cases]
    places = [part.world for part in found for _ in part.cases]
    assert [worlds[case.world] for case in read.missions] == places
    assert [case.command for case in read.missions] == [case.command for case in cases]
    assert [case.setup for case in read.missions] == [case.setup for case in cases]


def test_equal_worlds_share_a_file(tmp_path: Path) -> None:
    case = MissionCase(id="a", category="go", command="Drone_T01 to NorthGate")
    parts = [Found(shipped_world(), [case]), Found(shipped_world(), [case, case])]
    written = write_mission_set(tmp_path / "made.yaml", "made", "", parts)
    assert [case.id for case in written.missions] == ["G000", "G001", "G002"]
    assert [path.name for path in (tmp_path / "made-worlds").iterdir()] == ["w000.yaml"]


def test_missions_are_unlike_those_of_the_shipped_sets(found: list[Found]) -> None:
    known = NearDuplicates(shipped_missions())
    for part in found:
        assert all(known.keep([case.command for case in part.cases], part.world))


def test_missions_say_what_they_are(found: list[Found]) -> None:
    for part in found:
        for case in part.cases:
            assert case.category
            assert case.tags[0].partition("/")[0] == case.category
            assert case.success or case.expect != "execute"
