"""A world that cannot be simulated is refused with file, line, field and what to do."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.schema.document import DocumentError
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.worlds.world_file import geometry_problems, load_world, open_world
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
    with pytest.raises(DocumentError, match="Base has room for 1 such assets, 2 are posted"):
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
