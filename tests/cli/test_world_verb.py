"""`pa-console world` and `pa-console scenarios`."""

import shutil
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from pa_console.fleets import link as links
from pa_console.fleets.link import GROUP, FoundRobot
from pa_console.fleets.newcomers import survey
from pa_console.schema.incident import Scenario
from pa_console.schema.world import World
from pa_console.settings.schema import Settings
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.worlds.scenario_file import list_scenarios
from pa_console.sim.worlds.world_file import open_world
from tests.cli.inside import Call
from tests.fleets.scripted_link import Desk, ScriptedLink


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
    assert "ok, 2 events, 0 kinds of random event" in call("scenarios", "check", str(path)).said
    path = write(tmp_path / "one.yaml", f"{{at_s: 3, do: {SPAWN}}}")
    assert "ok, 1 event, 0 kinds of random event" in call("scenarios", "check", str(path)).said


@pytest.mark.parametrize(
    ("event", "field", "says"),
    [
        ("{at_s: 1, do: {kind: fail, asset: Drone_T99}}", "events.0.do.asset", "Drone_T01"),
        ("{at_s: 1, do: {kind: spawn, gate: Moon}}", "events.0.do.gate", "WestGate"),
        ("{at_s: -1, do: {kind: worker}}", "events.0.at_s", "greater than or equal to 0"),
        ("{do: {kind: worker}}", "events.0", "exactly one of at_s and when"),
        ("{at_s: 1, do: {kind: explode}}", "events.0.do", "explode"),
        ("{at_s: 1, soon: yes, do: {kind: worker}}", "events.0.soon", "no such field"),
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


class Finder(ScriptedLink):
    """A link that finds a robot the world does not have, and hears one that it has."""

    def discover(self) -> list[FoundRobot]:
        """Return what is on the link."""
        return [
            FoundRobot("walker", "robot", (0.4, 4.5), "of acme"),
            FoundRobot("no name", "robot"),
        ]


def open_finder(address: str, world: World, settings: Settings) -> Finder:
    link = Finder("own:lab", {"Drone_T01"} & world.assets.keys())
    if address == "lab":
        link.news.append(Desk(world).report("Drone_T01", world.base))
    return link


@pytest.fixture
def own_scheme(monkeypatch: pytest.MonkeyPatch) -> None:
    point = EntryPoint("own", f"{__name__}:open_finder", GROUP)
    monkeypatch.setattr(links, "link_schemes", lambda: {"own": point})
    monkeypatch.setattr(survey, "__defaults__", (0.2,))


@pytest.mark.usefixtures("own_scheme")
def test_a_world_from_robots_has_those_that_are_there_and_their_map(
    call: Call, tmp_path: Path
) -> None:
    (tmp_path / "lab.pgm").write_bytes(b"P5 4 2 255\n" + bytes((0, 255, 255, 0) * 2))
    lab = tmp_path / "lab.yaml"
    lab.write_text("image: lab.pgm\nresolution: 2.5\norigin: [0.0, 0.0, 0.0]\n", encoding="utf-8")
    path = tmp_path / "world.yaml"
    words = ["--fleet", "own:lab", "--map", str(lab), "-o", str(path)]
    words += ["--place", "Dock=1,1,base", "--place", "Door=9,1,gate", "--place", "Desk=1,4.5"]
    done = call("world", "from", *words)
    assert done.code == 0, done.err
    assert "walker of acme joins as a robot" in done.err
    assert "no name cannot join" in done.err
    assert f"pa-console console --world {path} --fleet own:lab" in done.said
    world, _ = open_world(str(path))
    posts = {name: (spec.kind, spec.post) for name, spec in world.assets.items()}
    assert posts == {"Drone_T01": ("uav", "Dock"), "walker": ("robot", "Desk")}
    assert world.gates == ("Door",)
    assert world.background is not None
    assert world.background.rows == ("#..#", "#..#")
    assert call("world", "check", str(path)).code == 0
    assert Checkpoint(world).picture().assets.keys() == posts.keys()


@pytest.mark.usefixtures("own_scheme")
@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--place", "Dock"), "NAME=X,Y"),
        (("--place", "Dock=1,here"), "NAME=X,Y"),
        (("--place", "Dock=1,1,pier"), "--place Dock: kind"),
        (("--place", "Dock=1,1,base"), "gate"),
        (("--map", "nowhere.yaml"), "nowhere.yaml"),
        (("--fleet", "other:1"), "no link 'other'"),
    ],
)
def test_what_makes_no_world_of_robots_is_said(
    call: Call, words: tuple[str, ...], says: str
) -> None:
    done = call("world", "from", "--fleet", "own:lab", *words)
    assert (done.code, done.out) == (2, "")
    assert says in done.err
