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
        ([transform(x=math.nan)], "a number in it is nan"),
        ([transform(x=-math.inf)], "a number in it is -inf"),
        ([transform(x=1e9)], "is no place on a map"),
        ([transform(w=0.0)], "its direction is no rotation"),
        ([transform(w=math.inf)], "a number in it is inf"),
        ([transform()] * 5000, "it has 5000 items"),
    ],
)
def test_hostile_transforms_are_set_aside(found: list[Any], why: str) -> None:
    with pytest.raises(UnreadableError, match=why):
        messages.read_transforms(Fields(transforms=found))


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
