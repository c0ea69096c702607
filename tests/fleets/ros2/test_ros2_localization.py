"""A robot's place follows its transforms, and what cannot be believed changes nothing."""

import math
from types import SimpleNamespace as Fields
from typing import Any

import pytest

from pa_console.fleets.ros2 import messages
from pa_console.fleets.ros2.localization import Localization
from pa_console.fleets.ros2.messages import Planar, Stamped, UnreadableError


def moved(parent: str, child: str, x: float, stamp: float) -> Stamped:
    return Stamped(parent, child, Planar(x, 0.0, 0.0), stamp)


def test_a_place_is_as_old_as_the_transform_of_the_wheels() -> None:
    robot = Localization("map", "base_link")
    robot.see_transforms([moved("base_footprint", "base_link", 0.5, 1.0)], 0.0, fixed=True)
    robot.see_transforms([moved("odom", "base_footprint", 3.0, 100.0)], 0.0)
    assert robot.place is None
    robot.see_transforms([moved("map", "odom", 10.0, 101.0)], 7.0)
    assert robot.place == (Planar(13.5, 0.0, 0.0), 100.0, 7.0)
    robot.see_transforms([moved("odom", "base_footprint", 1.0, 99.0)], 8.0)
    assert robot.place == (Planar(13.5, 0.0, 0.0), 100.0, 7.0)


def test_transforms_in_a_circle_give_no_place() -> None:
    robot = Localization("map", "base_link")
    robot.see_transforms([moved("a", "base_link", 1.0, 1.0), moved("base_link", "a", 1.0, 1.0)], 0)
    assert robot.place is None


def transform(x: float = 1.0, z: float = 0.0, w: float = 1.0) -> Any:
    return Fields(
        header=Fields(frame_id="/map", stamp=Fields(sec=12, nanosec=500_000_000)),
        child_frame_id="odom",
        transform=Fields(
            translation=Fields(x=x, y=2.0, z=0.0), rotation=Fields(x=0.0, y=0.0, z=z, w=w)
        ),
    )


def test_transforms_are_read() -> None:
    half = math.sqrt(0.5)
    (read,) = messages.read_transforms(Fields(transforms=[transform(z=half, w=half)]))
    assert (read.parent, read.child, read.stamp) == ("map", "odom", 12.5)
    assert read.pose == pytest.approx((1.0, 2.0, math.pi / 2))


@pytest.mark.parametrize(
    ("found", "why"),
    [
        ([transform(x=math.nan)], "it contains the number nan"),
        ([transform(x=-math.inf)], "it contains the number -inf"),
        ([transform(x=1e9)], "is not a place on a map"),
        ([transform(w=0.0)], "its direction is not a rotation"),
        ([transform(w=math.inf)], "it contains the number inf"),
        ([transform()] * 5000, "it has 5000 items"),
    ],
)
def test_hostile_transforms_are_set_aside(found: list[Any], why: str) -> None:
    with pytest.raises(UnreadableError, match=why):
        messages.read_transforms(Fields(transforms=found))


def grid(width: int = 2, height: int = 2, cell_m: float = 0.05, **other: Any) -> Any:
    origin = Fields(position=Fields(x=1.0, y=2.0), orientation=Fields(x=0.0, y=0.0, z=0.0, w=1.0))
    info = Fields(width=width, height=height, resolution=cell_m, origin=origin)
    data = other.get("data", [-1, 0, 100, -128])
    return Fields(header=Fields(frame_id="map"), info=info, data=data)


def test_a_map_is_read_from_the_top() -> None:
    read = messages.read_grid(grid())
    assert read.occupied.tolist() == [[True, False], [False, False]]
    assert read.free.tolist() == [[False, False], [False, True]]
    assert read.corner == (1.0, 2.0, 0.0)


@pytest.mark.parametrize(
    ("hostile", "why"),
    [
        (grid(width=0), "0 x 2 cells are not read"),
        (grid(width=2**31, height=2**31), "cells are not read"),
        (grid(height=3), "it has 4 of 6 cells"),
        (grid(data=[0]), "it has 1 of 4 cells"),
        (grid(cell_m=math.nan), "it contains the number nan"),
        (grid(cell_m=0.0), "a cell of 0 m is not a cell of a map"),
        (grid(cell_m=1e9), "is not a cell of a map"),
    ],
)
def test_hostile_maps_are_set_aside(hostile: Any, why: str) -> None:
    with pytest.raises(UnreadableError, match=why):
        messages.read_grid(hostile)


@pytest.mark.parametrize("share", [math.nan, -0.1, 1.5])
def test_a_charge_that_is_none_is_set_aside(share: float) -> None:
    with pytest.raises(UnreadableError):
        messages.read_battery(Fields(percentage=share))


@pytest.mark.parametrize(
    ("result", "reason"),
    [
        (Fields(), ""),  # Humble
        (Fields(error_code=208), "there is no path to the goal (Nav2 error 208)"),  # Jazzy
        (Fields(error_code=0, error_msg=""), ""),
        (Fields(error_code=731, error_msg="a\x1b[31mb"), "(Nav2 error 731): a"),
    ],
)
def test_the_reason_of_a_failure_is_that_of_every_release(result: Any, reason: str) -> None:
    state, said = messages.read_result(Fields(status=6, result=result))
    assert state == 6
    assert said[: len(reason)] == reason
    assert said.isprintable()
