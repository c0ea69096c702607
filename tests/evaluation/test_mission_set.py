"""Mission files: the shipped ones load, and a wrong one is refused with file, line and field."""

from pathlib import Path

import pytest

from pa_console.evaluation.jobs import load_missions
from pa_console.resources import data_folder
from pa_console.schema.document import DocumentError
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.worlds.world_file import load_world

FOLDER = data_folder() / "worlds" / "checkpoint"
WORLD = load_world(FOLDER / "world.yaml")
GOOD = "{id: A, category: c, command: look around}"


def test_the_papers_ten_load_and_their_set_up_can_be_brought_about() -> None:
    missions = load_missions(FOLDER / "missions" / "paper.yaml", WORLD).missions
    assert [case.id for case in missions] == [f"P{number:02d}" for number in range(1, 11)]
    for case in missions:
        sim = Checkpoint(WORLD)
        for incident in case.setup:
            sim.inject(incident)
        sim.step()


@pytest.mark.parametrize(
    ("entry", "field"),
    [
        ("{id: A, category: c, command: look}", "id"),
        ("{id: B, category: c}", "command"),
        ("{id: B, category: c, command: ''}", "command"),
        ("{id: B, category: c, command: x, sucess: []}", "sucess"),
        ("{id: B, category: c, command: x, setup: [{kind: spawn, gate: Moon}]}", "gate"),
        ("{id: B, category: c, command: x, setup: [{kind: fail, asset: Moon}]}", "asset"),
        ("{id: B, category: c, command: x, setup: [{kind: explode}]}", "setup"),
        ("{id: B, category: c, command: x, success: ['true', 'run.']}", "success.1"),
        ("{id: B, category: c, command: x, success: [run.actoins == 0]}", "success.0"),
        ("{id: B, category: c, command: x, success: ['run.coverage.Moon.at_end']}", "success.0"),
        (
            "{id: B, category: c, command: x, setup: [{kind: place, asset: Drone_T01, frame: X}]}",
            "frame",
        ),
    ],
)
def test_a_wrong_entry_is_named_by_line_and_field(tmp_path: Path, entry: str, field: str) -> None:
    path = tmp_path / "missions.yaml"
    path.write_text(f"name: mine\nmissions:\n  - {GOOD}\n  - {entry}\n")
    with pytest.raises(DocumentError) as caught:
        load_missions(path, WORLD)
    assert caught.value.line == 4
    assert field in caught.value.field
    assert str(path) in str(caught.value)
