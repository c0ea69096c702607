"""The connection file names what is wrong in it, and fits a map to the world."""

import math
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.fleets.ros2.connection import MapFit, RobotEntry, read_site
from pa_console.fleets.ros2.link import open_link
from pa_console.fleets.ros2.messages import Planar
from pa_console.schema.document import DocumentError
from pa_console.schema.world import World
from pa_console.settings.schema import Settings

GOOD = "frames: {NorthGate: [0, 34], EastGate: [54, 0]}\nrobots: {Ugv_T01: {}}\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("robots: {Ugv_T01: {}}\n", "frames: Field required"),
        (GOOD.replace("EastGate", "Moon"), ":1: frames.Moon: not a frame of checkpoint; it has"),
        (GOOD.replace("Ugv_T01", "Ugv_T99"), ":2: robots.Ugv_T99: not an asset of checkpoint;"),
        (
            GOOD.replace("54, 0", "50, 0"),
            ":1: frames.EastGate: the map does not fit the world: EastGate is",
        ),
        (GOOD.replace("{}", "{can: [observe]}"), "can.0: a ugv cannot observe"),
        (GOOD.replace("{}", "{trees: {identify: a.xml}}"), "add identify to 'can'"),
        (GOOD.replace("{}", "{namespace: a b}"), "robots.Ugv_T01.namespace"),
        (
            GOOD.replace("{Ugv_T01: {}}", "{Ugv_T01: {namespace: a}, Ugv_T02: {namespace: a}}"),
            "Ugv_T01 has the action /a/navigate_to_pose as well",
        ),
        (GOOD + "domain: 500\n", "domain: Input should be less than or equal to 232"),
    ],
)
def test_an_error_names_file_line_and_field(
    text: str, said: str, world: World, tmp_path: Path
) -> None:
    path = tmp_path / "robots.yaml"
    path.write_text(text)
    with pytest.raises(DocumentError) as raised:
        read_site(path, world)
    assert str(raised.value).startswith(str(path))
    assert said in str(raised.value)


def test_a_file_that_is_not_there_is_named(world: World) -> None:
    with pytest.raises(ValueError, match=r"/none/there.yaml: No such file"):
        open_link("/none/there.yaml", world, Settings())


def test_without_ros_2_the_remedy_is_named(
    world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("rclpy", "pa_console.fleets.ros2.node"):
        monkeypatch.setitem(sys.modules, name, None)
    path = tmp_path / "robots.yaml"
    path.write_text(GOOD)
    with pytest.raises(ValueError, match=r"setup.bash.*--system-site-packages"):
        open_link(str(path), world, Settings())


@pytest.mark.parametrize(
    ("entry", "name", "full"),
    [
        ({}, "odom", "/Ugv_T01/odom"),
        ({"namespace": "/fleet/ugv1"}, "odom", "/fleet/ugv1/odom"),
        ({"namespace": ""}, "navigate_to_pose", "/navigate_to_pose"),
        ({"namespace": "ugv1"}, "/tf", "/tf"),
    ],
)
def test_names_are_in_the_namespace_of_the_robot(
    entry: dict[str, str], name: str, full: str
) -> None:
    assert RobotEntry.model_validate(entry).named("Ugv_T01", name) == full


COORDINATE = st.floats(-200.0, 200.0)
FRAMES = {"a": (0.0, 34.0), "b": (54.0, 0.0), "c": (-54.0, 0.0)}


@given(COORDINATE, COORDINATE, st.floats(-math.pi, math.pi), st.integers(2, 3))
def test_a_map_that_is_turned_and_moved_fits(x: float, y: float, turn: float, count: int) -> None:
    in_world = dict(list(FRAMES.items())[:count])
    there = Planar(x, y, turn)
    on_map = {name: there.then(Planar(*at, 0.0))[:2] for name, at in in_world.items()}
    fit = MapFit.of(on_map, in_world)
    assert fit.worst[1] == pytest.approx(0.0, abs=1e-6)
    pose = Planar(3.0, -4.0, 1.0)
    assert fit.to_world(there.then(pose))[:2] == pytest.approx(pose[:2], abs=1e-6)
    assert fit.to_map(fit.to_world(pose)) == pytest.approx(pose, abs=1e-6)


@given(st.floats(0.5, 2.0).filter(lambda scale: abs(scale - 1.0) > 0.05))
def test_a_map_on_another_scale_does_not(scale: float) -> None:
    on_map = {name: (x * scale, y * scale) for name, (x, y) in FRAMES.items()}
    assert MapFit.of(on_map, FRAMES).worst[1] > 1.0


def test_the_frame_that_is_off_most_is_named() -> None:
    on_map = {**FRAMES, "d": (0.0, -40.0)}
    in_world = {**FRAMES, "d": (0.0, -34.0)}
    assert MapFit.of(on_map, in_world).worst[0] == "d"
