"""A world that cannot be simulated is refused with file, line, field and what to do."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pa_console.schema.document import DocumentError
from pa_console.schema.world import AssetKind, World
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.worlds.scenario_file import list_scenarios, load_scenario, scenario_path
from pa_console.sim.worlds.terrain import Terrain
from pa_console.sim.worlds.world_file import geometry_problems, load_world, open_world
from pa_console.sim.worlds.world_generator import MOST_GATES, generate_world, world_yaml
from tests.sim.running import order, run

JUNK: st.SearchStrategy[object] = st.one_of(
    st.none(), st.integers(-200, 200), st.floats(), st.text(max_size=3)
)


def test_the_default_checkpoint_is_as_designed(world: World) -> None:
    assert set(world.gates) == {"NorthGate", "EastGate", "SouthGate", "WestGate"}
    assert world.base == "Base"
    assert {name: (spec.kind, spec.post) for name, spec in world.assets.items()} == {
        "Drone_T01": ("uav", "WestGate"),
        "Drone_T02": ("uav", "NorthGate"),
        "Drone_T03": ("uav", "SouthGate"),
        "Drone_T04": ("uav", "Checkpoint"),
        "Ugv_T01": ("ugv", "EastGate"),
        "Ugv_T02": ("ugv", "Checkpoint"),
        "Robot_T01": ("robot", "Checkpoint"),
        "Robot_T02": ("robot", "Base"),
    }
    assert {lane.gate for lane in world.lanes.values()} == set(world.gates)
    assert not list(geometry_problems(world))


@pytest.mark.parametrize(
    ("field", "value", "expected"),
    [
        ("frames.NorthGate.at", [30, 40], "walls.1"),
        ("frames.Checkpoint.at", [50, 0], "overlaps"),
        ("lanes.NorthLane.points", [[0, 150], [0, 90]], "must be within 15 m"),
        ("lanes.EastLane.points", [[170, 20], [125, 0], [125, 0]], "repeated"),
        ("lanes.WestLane.points", [[-170, 20], [-62, 20], [-55, 5]], "runs through walls"),
        ("dt_s", 1e-9, "out of range"),
        ("platforms.uav.speed_mps", 1e6, "out of range; it must be from 0.05 to 100"),
        ("frames.Base.at", [1e9, 0], "out of range"),
        ("walls.0.end", [-60, 40], "same point"),
        ("zones.Depot.polygon", [[0, 0], [10, 10], [10, 0], [0, 10]], "cross"),
        ("lanes.NorthLane.gate", "Checkpoint", "not a gate frame"),
        ("assets.Ugv_T01.post", "Nowhere", "not a frame"),
        ("platforms.ugv.speed_mps", -1, "greater than 0"),
        ("assets.Robot_T01.colour", "red", "there is no such field"),
        ("cameras.NorthCamera.gate", "Base", "not a gate frame"),
        ("cameras.NorthCamera.heading_deg", 500.0, "out of range"),
        ("cameras.NorthCamera.field_of_view_deg", 0.0, "greater than 0"),
        ("cameras.NorthCamera.sensor_range_m", 1e6, "out of range"),
        ("origin.latitude", 91.0, "less than or equal to 90"),
        ("origin.longitude", -180.5, "greater than or equal to -180"),
        ("origin.bearing", 360.0, "less than 360"),
        ("origin.altitude", 1e5, "less than or equal to 9000"),
    ],
)
def test_bad_field_is_named_with_its_line(
    world_path: Path, tmp_path: Path, field: str, value: object, expected: str
) -> None:
    document = yaml.safe_load(world_path.read_text())
    document["origin"] = {"latitude": 2.0, "longitude": -30.0}
    _set(document, field, value)
    path = tmp_path / "world.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    with pytest.raises(DocumentError) as caught:
        load_world(path)
    error = caught.value
    assert error.field == field
    assert re.search(expected, str(error))
    key = field.rsplit(".", 1)[-1]
    line = path.read_text().splitlines()[error.line - 1]
    assert f"{key}:" in line
    assert str(error).startswith(f"{path}:{error.line}: ")


def test_more_assets_than_a_frame_has_room_for(world_path: Path, tmp_path: Path) -> None:
    document = yaml.safe_load(world_path.read_text())
    document["frames"]["Base"]["radius_m"] = 0.6
    document["assets"]["Robot_T01"]["post"] = "Base"
    path = tmp_path / "world.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    with pytest.raises(DocumentError, match="Base has room for 1 such assets, but 2 are posted"):
        load_world(path)


def test_gate_without_a_lane_is_fine(world_path: Path, tmp_path: Path) -> None:
    document = yaml.safe_load(world_path.read_text())
    del document["lanes"]["SouthLane"]
    path = tmp_path / "world.yaml"
    path.write_text(yaml.safe_dump(document))
    assert "SouthGate" in load_world(path).gates


def test_missing_file_and_broken_yaml(tmp_path: Path) -> None:
    with pytest.raises(DocumentError, match="No such file"):
        load_world(tmp_path / "none.yaml")
    path = tmp_path / "world.yaml"
    path.write_text("name: [")
    with pytest.raises(DocumentError, match="not valid YAML"):
        load_world(path)


@given(data=st.data())
@settings(max_examples=60, deadline=None)
def test_a_damaged_world_is_refused_or_can_be_simulated(
    world_path: Path, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    document = yaml.safe_load(world_path.read_text())
    field = data.draw(st.sampled_from(list(_fields(document))))
    _set(document, field, data.draw(JUNK | st.lists(JUNK, max_size=3)))
    path = tmp_path_factory.mktemp("worlds") / "world.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    world = _load_or_check_error(path)
    if world is not None:
        sim = Checkpoint(world)
        for agent in world.assets:
            order(sim, agent, "return_to_base")
        run(sim, 5 * world.dt_s)
        assert sim.tick == 5


def _load_or_check_error(path: Path) -> World | None:
    message = ""
    try:
        return load_world(path)
    except DocumentError as error:
        message = str(error)
    assert str(path) in message
    return None


def _fields(node: Any, prefix: str = "") -> Iterator[str]:
    """Yield the dotted path of every field and every list item below `node`."""
    keys: Any = node.keys() if hasattr(node, "keys") else range(len(node))
    for key in keys:
        yield f"{prefix}{key}"
        if isinstance(node[key], dict | list):
            yield from _fields(node[key], f"{prefix}{key}.")


def _set(document: Any, field: str, value: object) -> None:
    *folders, last = field.split(".")
    for folder in folders:
        document = document[int(folder) if folder.isdigit() else folder]
    document[int(last) if last.isdigit() else last] = value


def test_who_names_a_world_that_is_not_there_is_told_which_are() -> None:
    with pytest.raises(DocumentError, match=r"nowhere: .* installed: checkpoint"):
        open_world("nowhere")


SEEDS = st.integers(0, 10_000)


@given(gates=st.integers(1, 50), assets=st.integers(1, 120), seed=SEEDS)
@example(gates=50, assets=120, seed=1)
@example(gates=1, assets=1, seed=0)
@settings(max_examples=8, deadline=None)
def test_every_generated_world_loads_and_starts_with_its_gates_covered(
    gates: int, assets: int, seed: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    world = generate_world(gates, assets, seed)
    assert (len(world.gates), len(world.assets)) == (gates, assets)
    path = tmp_path_factory.mktemp("worlds") / "world.yaml"
    path.write_text(world_yaml(world), encoding="utf-8")
    assert load_world(path) == world
    posted = {spec.post for spec in world.assets.values()} & set(world.gates)
    assert assets < gates or posted == set(world.gates)
    picture = Checkpoint(world, seed).picture()
    assert {gate for gate, cover in picture.gates.items() if cover.covered} == posted


@given(gates=st.integers(1, 30), seed=SEEDS, data=st.data())
@settings(max_examples=10, deadline=None)
def test_every_gate_has_a_lane_and_a_camera_and_can_be_reached_with_room_for_several(
    gates: int, seed: int, data: st.DataObject
) -> None:
    world = generate_world(gates, 12, seed)
    assert {lane.gate for lane in world.lanes.values()} == set(world.gates)
    assert {camera.gate for camera in world.cameras.values()} == set(world.gates)
    terrain = Terrain(world)
    gate = data.draw(st.sampled_from(world.gates))
    kinds: tuple[AssetKind, ...] = ("uav", "ugv", "robot")
    for kind in kinds:
        for start in (world.base, next(n for n, f in world.frames.items() if f.kind == "post")):
            [here, *_] = terrain.places(start, kind)
            assert terrain.planner.route(kind, here, terrain.places(gate, kind)[0])
        assert len(terrain.places(gate, kind)) >= 6
        assert len(terrain.places(world.base, kind)) >= 12


def test_seeds_differ_and_equal_arguments_do_not() -> None:
    assert generate_world(4, 8, 1) == generate_world(4, 8, 1)
    worlds: list[World] = [generate_world(4, 8, seed) for seed in range(6)]
    assert len({world.perimeter for world in worlds}) == 6
    assert len({world.gates for world in worlds}) == 6
    assert len({len(world.perimeter) for world in worlds}) > 1


@pytest.mark.parametrize(("gates", "assets"), [(0, 5), (MOST_GATES + 1, 5), (4, 0), (4, 10**6)])
def test_numbers_out_of_range_are_refused(gates: int, assets: int) -> None:
    with pytest.raises(ValueError, match="out of range; it must be from 1 to"):
        generate_world(gates, assets, 0)


def test_a_large_generated_world_lives_and_forks_exactly() -> None:
    world = generate_world(12, 150, 3)
    sim, twin = Checkpoint(world, 1), Checkpoint(world, 1)
    for each in (sim, twin):
        for number, (name, spec) in enumerate(world.assets.items()):
            if spec.post not in world.gates and number % 3 == 0:
                order(each, name, "move_to", world.gates[number % 12], command_id=name)
        run(each, 10.0)
    fork = sim.fork()
    ends = {reply.command_id: reply.status for reply in run(sim, 30.0)}
    run(twin, 30.0)
    run(fork, 30.0)
    assert "done" in ends.values()
    assert sim.state_hash() == twin.state_hash() == fork.state_hash()


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
         "a condition must name a track, an asset or an event"),
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
