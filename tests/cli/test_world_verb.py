"""`pa-console world`: what it generates opens again, and nothing is written over by accident."""

from pathlib import Path

import pytest

from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.worlds.world_file import open_world
from tests.cli.inside import Call


def test_a_generated_world_opens_again_with_what_was_asked_for(call: Call, tmp_path: Path) -> None:
    path = tmp_path / "new" / "yard.yaml"
    done = call("world", "generate", "--gates", "6", "--assets", "14", "-o", str(path))
    assert done.code == 0
    assert str(path) in done.said
    world, found = open_world(str(path))
    assert (len(world.gates), len(world.assets), found) == (6, 14, path)
    assert all(cover.covered for cover in Checkpoint(world).picture().gates.values())
    checked = call("world", "check", str(path))
    assert checked.code == 0
    assert "6 gates, 14 assets" in checked.said


def test_without_a_file_the_world_is_all_of_stdout(call: Call, tmp_path: Path) -> None:
    words = ("world", "generate", "--gates", "3", "--assets", "5", "--seed", "7")
    one, again = call(*words), call(*words)
    assert one.code == 0
    assert one.out == again.out
    path = tmp_path / "copy.yaml"
    path.write_text(one.out, encoding="utf-8")
    assert len(open_world(str(path))[0].gates) == 3
    assert call(*words[:-1], "8").out != one.out


def test_an_existing_file_is_written_over_only_with_force(call: Call, tmp_path: Path) -> None:
    path = tmp_path / "world.yaml"
    path.write_text("precious", encoding="utf-8")
    words = ("world", "generate", "--gates", "2", "--assets", "3", "--out", str(path))
    refused = call(*words)
    assert refused.code == 2
    assert str(path) in refused.err
    assert "--force" in refused.err
    assert path.read_text(encoding="utf-8") == "precious"
    assert call(*words, "--force").code == 0
    assert call("world", "check", str(path)).code == 0


@pytest.mark.parametrize(
    ("option", "number", "says"),
    [
        ("--gates", "0", "gates"),
        ("--gates", "100000", "gates"),
        ("--assets", "-1", "assets"),
        ("--assets", "1000000", "assets"),
        ("--gates", "many", "--gates"),
    ],
)
def test_bad_numbers_are_refused_with_the_range_that_is_taken(
    call: Call, tmp_path: Path, option: str, number: str, says: str
) -> None:
    path = tmp_path / "world.yaml"
    done = call("world", "generate", option, number, "-o", str(path))
    assert (done.code, done.out) == (2, "")
    assert says in done.err
    assert number == "many" or "from 1 to" in done.err
    assert not path.exists()


def test_check_tells_which_gates_nobody_covers(call: Call, tmp_path: Path) -> None:
    path = tmp_path / "few.yaml"
    call("world", "generate", "--gates", "5", "--assets", "2", "-o", str(path))
    world, _ = open_world(str(path))
    bare = [gate for gate, cover in Checkpoint(world).picture().gates.items() if not cover.covered]
    done = call("world", "check", str(path))
    assert done.code == 0
    assert bare
    assert all(gate in done.said for gate in bare)


def test_a_broken_world_is_told_with_line_and_field(call: Call, tmp_path: Path) -> None:
    path = tmp_path / "world.yaml"
    call("world", "generate", "--gates", "2", "--assets", "3", "-o", str(path))
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("standoff_m: ", "standoff_m: -"), encoding="utf-8")
    line = next(n for n, row in enumerate(text.splitlines(), 1) if row.startswith("standoff_m:"))
    done = call("world", "check", str(path))
    assert (done.code, done.out) == (2, "")
    assert f"{path}:{line}: standoff_m" in done.err
