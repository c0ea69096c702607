"""`pa-console scenarios`: what may happen in a world, told before it is played."""

import shutil
from pathlib import Path

import pytest

from pa_console.schema.incident import Scenario
from pa_console.sim.worlds.scenario_file import list_scenarios
from pa_console.sim.worlds.world_file import open_world
from tests.cli.inside import Call

SPAWN = "{kind: spawn, gate: WestGate, name: Van}"


def write(path: Path, *events: str, title: str = "A test") -> Path:
    """Write a scenario whose first event is on line 6."""
    head = [f"name: {path.stem}", f'title: "{title}"', "about: for a test", "duration_s: 20"]
    path.write_text("\n".join([*head, "events:", *(f"  - {event}" for event in events), ""]))
    return path


def test_every_shipped_situation_is_listed_shown_and_right(call: Call) -> None:
    listed = call("scenarios", "list", "--json").json
    _, path = open_world("checkpoint")
    assert [(row["name"], row["title"]) for row in listed] == list_scenarios(path)
    table = call("scenarios", "list")
    for row in listed:
        assert row["name"] in table.out
        shown = call("scenarios", "show", row["name"])
        assert shown.code == 0
        assert row["title"] in shown.said
        shown = call("scenarios", "show", row["name"], "--json")
        assert Scenario.model_validate_json(shown.out).title == row["title"]
        file = path.parent / "scenarios" / f"{row['name']}.yaml"
        assert call("scenarios", "check", str(file)).code == 0


def test_every_kind_of_trigger_is_told_in_words(call: Call, tmp_path: Path) -> None:
    path = write(
        tmp_path / "triggers.yaml",
        f"{{name: arrival, at_s: 3, do: {SPAWN}}}",
        "{when: {track: Van, state: observed}, delay_s: 2, do: {kind: fail, asset: Drone_T01}}",
        "{when: {asset: Ugv_T01, state: arrived, at: EastGate}, do: {kind: worker}}",
        "{when: {event: arrival}, do: {kind: weather, weather: fog}}",
    )
    said = call("scenarios", "show", str(path)).said
    for words in (
        "3 s",
        "when Van is observed + 2 s",
        "when Ugv_T01 has arrived at EastGate",
        "after arrival",
    ):
        assert words in said


def test_who_comes_and_what_becomes_of_it_is_told_plainly(call: Call, tmp_path: Path) -> None:
    turn = "{kind: turn, track: Van, intent: hostile, when_warned: go_on}"
    path = write(tmp_path / "turn.yaml", f"{{at_s: 3, do: {SPAWN}}}", f"{{at_s: 9, do: {turn}}}")
    said = call("scenarios", "show", str(path)).said
    van = "a vehicle (Van) appears on the lane to WestGate"
    assert f"{van}: unauthorized, benign, leaves when warned" in said
    assert "Van from now on: hostile, goes on when warned" in said
    assert "ok, 2 events, 0 random kinds" in call("scenarios", "check", str(path)).said
    path = write(tmp_path / "one.yaml", f"{{at_s: 3, do: {SPAWN}}}")
    assert "ok, 1 event, 0 random kinds" in call("scenarios", "check", str(path)).said


@pytest.mark.parametrize(
    ("event", "field", "says"),
    [
        ("{at_s: 1, do: {kind: fail, asset: Drone_T99}}", "events.0.do.asset", "Drone_T01"),
        ("{at_s: 1, do: {kind: spawn, gate: Moon}}", "events.0.do.gate", "WestGate"),
        ("{at_s: -1, do: {kind: worker}}", "events.0.at_s", "greater than or equal to 0"),
        ("{do: {kind: worker}}", "events.0", "exactly one of at_s and when"),
        ("{at_s: 1, do: {kind: explode}}", "events.0.do", "explode"),
        ("{at_s: 1, soon: yes, do: {kind: worker}}", "events.0.soon", "not permitted"),
        ("{when: {track: Nobody, state: gone}, do: {kind: worker}}", "events.0", "Nobody"),
    ],
)
def test_a_broken_file_is_refused_with_file_line_and_field(
    call: Call, tmp_path: Path, event: str, field: str, says: str
) -> None:
    path = write(tmp_path / "broken.yaml", event)
    for words in (["scenarios", "check"], ["scenarios", "show"]):
        done = call(*words, str(path))
        assert (done.code, done.out) == (2, "")
        assert f"{path}:6: {field}" in done.err
        assert says in done.err


def test_an_unknown_situation_is_answered_with_those_that_there_are(call: Call) -> None:
    for verb in ("show", "check"):
        done = call("scenarios", verb, "nowhere-to-be-found")
        assert done.code == 2
        assert "situation-2" in done.err


def test_brackets_in_a_title_and_a_path_are_text(call: Call, tmp_path: Path) -> None:
    world = tmp_path / "site [a]"
    (world / "scenarios").mkdir(parents=True)
    shutil.copy(open_world("checkpoint")[1], world / "world.yaml")
    path = write(world / "scenarios" / "odd.yaml", f"{{at_s: 1, do: {SPAWN}}}", title="[/b] odd")
    here = ("--world", str(world))
    assert "[/b] odd" in call("scenarios", "list", *here).said
    assert "[/b] odd" in call("scenarios", "show", "odd", *here).said
    assert str(path) in call("scenarios", "check", str(path), *here).out


def test_a_situation_of_another_world_is_refused(call: Call, tmp_path: Path) -> None:
    world = tmp_path / "world.yaml"
    call("world", "generate", "--gates", "2", "--assets", "3", "-o", str(world))
    assert call("scenarios", "list", "--world", str(world), "--json").json == []
    own = open_world("checkpoint")[1].parent / "scenarios" / "situation-2.yaml"
    done = call("scenarios", "check", str(own), "--world", str(world))
    assert done.code == 2
    assert f"{own}:" in done.err
