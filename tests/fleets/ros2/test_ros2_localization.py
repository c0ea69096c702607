"""A robot's place follows its transforms, and each place has the speed of its own time."""

import pytest

from pa_console.fleets.ros2.localization import Localization
from pa_console.fleets.ros2.messages import Planar, Stamped


def moved(parent: str, child: str, x: float, stamp: float) -> Stamped:
    return Stamped(parent, child, Planar(x, 0.0, 0.0), stamp)


def test_a_place_is_as_old_as_the_transform_of_the_wheels() -> None:
    robot = Localization("map", "base_link", "tf")
    robot.see_transforms([moved("base_footprint", "base_link", 0.5, 1.0)], 0.0, fixed=True)
    robot.see_transforms([moved("odom", "base_footprint", 3.0, 100.0)], 0.0)
    assert robot.place is None
    robot.see_transforms([moved("map", "odom", 10.0, 101.0)], 7.0)
    assert robot.place == (Planar(13.5, 0.0, 0.0), 100.0, 7.0)
    robot.see_transforms([moved("odom", "base_footprint", 1.0, 99.0)], 8.0)
    assert robot.place == (Planar(13.5, 0.0, 0.0), 100.0, 7.0)


def test_transforms_in_a_circle_give_no_place() -> None:
    robot = Localization("map", "base_link", "tf")
    robot.see_transforms([moved("a", "base_link", 1.0, 1.0), moved("base_link", "a", 1.0, 1.0)], 0)
    assert robot.place is None


def test_a_place_has_the_speed_that_was_measured_then() -> None:
    robot = Localization("map", "base_link", "odom")
    for second, speed in enumerate((0.0, 4.0, 0.0)):
        robot.see_odometry(moved("odom", "base_link", 0.0, float(second)), speed, 9.0)
    assert [robot.speed(float(second)) for second in range(3)] == [0.0, 4.0, 0.0]


def test_without_odometry_two_places_give_a_speed() -> None:
    robot = Localization("map", "base_link", "tf")
    for tick in range(11):
        robot.see_transforms([moved("map", "base_link", 0.2 * tick, 0.1 * tick)], 0.0)
    assert robot.speed(1.0) == pytest.approx(2.0)
