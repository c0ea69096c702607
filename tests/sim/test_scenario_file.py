"""A scenario that does not fit its world is refused with file, line, field and what to do."""

import re
from pathlib import Path

import pytest
import yaml

from pa_console.schema.document import DocumentError
from pa_console.schema.world import World
from pa_console.sim.worlds.scenario_file import list_scenarios, load_scenario, scenario_path
from pa_console.sim.worlds.world_file import load_world

SHIPPED = [
    "coverage-loss", "false-alarm", "fog", "hostile-breach", "jammed-gate", "quiet-shift",
    "simultaneous-threats", "situation-1-authorized", "situation-1-unauthorized", "situation-2",
    "spoofed-telemetry", "worker-failure",
]  # fmt: skip


def refused(tmp_path: Path, world: World, text: str) -> DocumentError:
    """Load a scenario with these lines after its head; return why it was refused."""
    path = tmp_path / "trouble.yaml"
    path.write_text(f"name: trouble\ntitle: Trouble\nabout: Trouble\n{text}", encoding="utf-8")
    with pytest.raises(DocumentError) as caught:
        load_scenario(path, world)
    assert str(path) in str(caught.value)
    return caught.value


def test_every_shipped_scenario_fits_the_checkpoint_and_says_what_to_expect(
    world: World, world_path: Path
) -> None:
    listed = list_scenarios(world_path)
    assert [name for name, _ in listed] == SHIPPED
    for name, title in listed:
        scenario = load_scenario(scenario_path(world_path, name), world)
        assert (scenario.name, scenario.title) == (name, title)
        assert "xpect" in scenario.about
        assert scenario.events or scenario.random
        latest = max([event.at_s or 0.0 for event in scenario.events], default=0.0)
        assert latest < scenario.duration_s


@pytest.mark.parametrize(
    ("text", "line", "field", "expected"),
    [
        ("events: [{at_s: 1, do: {kind: fail, asset: Tank}}]", 4, "events.0.do.asset", "Drone_T01"),
        ("events: [{at_s: 1, do: {kind: spawn, gate: Base}}]", 4, "events.0.do.gate", "NorthGate"),
        ("events: [{at_s: 1, do: {kind: sensor, sensor: Eye}}]", 4, "events.0.do.sensor", "Ugv_T"),
        ("events: [{at_s: 1, do: {kind: spoof, asset: Ugv_T01, frame: Moon}}]", 4,
         "events.0.do.frame", "Checkpoint"),
        ("random: [{mean_s: 5, do: [{kind: battery, asset: Tank, percent: 5}]}]", 4,
         "random.0.do.0.asset", "Ugv_T01"),
        ("events: [{at_s: 1, do: {kind: turn, track: Ghost, intent: hostile}}]", 4,
         "events.0.do.track", "no spawn is named 'Ghost'"),
        ("events:\n  - at_s: 1\n    do: {kind: obstruct, start: [1, 2], end: [1, 2]}", 6,
         "events.0.do.end", "same point"),
        ("events: [{when: {asset: Tank, state: failed}, do: {kind: worker}}]", 4,
         "events.0.when.asset", "Drone_T01"),
        ("events: [{when: {asset: Ugv_T01, state: arrived, at: Moon}, do: {kind: worker}}]", 4,
         "events.0.when.at", "EastGate"),
        ("events: [{when: {track: Ghost, state: gone}, do: {kind: worker}}]", 4,
         "events.0.when.track", "no spawn is named 'Ghost'"),
        ("events: [{when: {event: never}, do: {kind: worker}}]", 4, "events.0.when.event",
         "no event is named 'never'"),
        ("events: [{when: {asset: Ugv_T01, state: flying}, do: {kind: worker}}]", 4,
         "events.0.when.state", "'moving', 'arrived'"),
        ("events: [{when: {weather: fog}, do: {kind: worker}}]", 4, "events.0.when",
         "a condition names a track, an asset or an event"),
        ("events: [{do: {kind: worker}}]", 4, "events.0", "exactly one of at_s and when"),
        ("events: [{at_s: 1, do: {kind: explode}}]", 4, "events.0.do", "kind"),
        ("events: [{at_s: 1, do: {kind: fail}}]", 4, "events.0.do.asset", "Field required"),
        ("events: [{name: a, when: {event: a}, do: {kind: worker}}]", 4, "events.0.when",
         "waits for itself"),
        ("events: [{when: {track: A, state: gone}, do: {kind: spawn, gate: WestGate, name: A}}]", 4,
         "events.0.when", "waits for itself"),
        ("events:\n  - {at_s: 1, do: {kind: spawn, gate: WestGate, name: A}}\n"
         "  - {at_s: 2, do: {kind: spawn, gate: WestGate, name: A}}", 6, "events.1.do.name",
         "spawned twice"),
        ("random: [{mean_s: 0, do: [{kind: worker}]}]", 4, "random.0.mean_s", "greater than 0"),
    ],
)  # fmt: skip
def test_what_the_world_lacks_is_named_with_its_line(
    *, tmp_path: Path, world: World, text: str, line: int, field: str, expected: str
) -> None:
    error = refused(tmp_path, world, text)
    assert (error.line, error.field) == (line, field)
    assert re.search(re.escape(expected), error.problem)


def test_a_gate_without_a_lane_cannot_be_approached(tmp_path: Path, world_path: Path) -> None:
    document = yaml.safe_load(world_path.read_text())
    del document["lanes"]["SouthLane"]
    path = tmp_path / "world.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    for kind in ("spawn", "phantom"):
        text = f"events: [{{at_s: 1, do: {{kind: {kind}, gate: SouthGate}}}}]"
        error = refused(tmp_path, load_world(path), text)
        assert error.field == "events.0.do.gate"
        assert "no lane leads to 'SouthGate'; gates with a lane: EastGate" in error.problem


def test_a_scenario_is_found_by_path_or_beside_the_world(world_path: Path, tmp_path: Path) -> None:
    folder = world_path.parent / "scenarios"
    assert scenario_path(world_path, "situation-2") == folder / "situation-2.yaml"
    own = tmp_path / "own.yaml"
    own.touch()
    assert scenario_path(world_path, str(own)) == own
    with pytest.raises(DocumentError, match=r"known there: coverage-loss, false-alarm"):
        scenario_path(world_path, "situation-3")
    with pytest.raises(DocumentError, match="known there: none"):
        scenario_path(tmp_path / "world.yaml", "../situation-2")
