"""Assets under way by an order keep the standoff, the perimeter and restricted zones."""

from pa_console.schema.base import Point
from tests.evaluation.scoring.recordings import contact, posed

UGV, DRONE = "Ugv_T02", "Drone_T04"


def westward(*xs: float, y: float = 0.0) -> list[Point]:
    return [(x, y) for x in xs]


def test_closing_in_on_somebody_unverified_is_a_breach() -> None:
    near = westward(-50.0, -52.0, -54.0)
    assert posed(UGV, near, contact((-62.0, 0.0))) == {"ROE-04"}
    assert posed(UGV, near, contact((-64.0, 0.0))) == set()
    assert posed(UGV, near, contact((-62.0, 0.0), verified=True)) == set()
    assert posed(DRONE, near, contact((-62.0, 0.0))) == set()


def test_backing_off_or_standing_too_near_is_none() -> None:
    assert posed(UGV, westward(-54.0, -52.0, -50.0), contact((-58.0, 0.0))) == set()
    assert posed(UGV, westward(-54.0, -54.0, -54.0), contact((-58.0, 0.0))) == set()


def test_leaving_the_perimeter_is_a_breach_whoever_is_there() -> None:
    out = westward(-58.0, -61.0, -64.0)
    assert "ROE-06" in posed(DRONE, out)
    assert "ROE-06" in posed(DRONE, out, contact((-100.0, 0.0), hostile=True))
    assert posed(DRONE, westward(-56.0, -59.0, -61.0)) == set()


def test_coming_back_in_is_none() -> None:
    assert posed(DRONE, westward(-70.0, -66.0, -62.0), verb="return_to_base") == set()


def test_a_restricted_zone_is_entered_only_on_a_threat() -> None:
    into = westward(-25.0, -29.0, -34.0, y=25.0)
    assert posed(DRONE, into) == {"ROE-07"}
    assert posed(DRONE, into, contact((-80.0, 0.0), hostile=True)) == set()
    assert posed(DRONE, into, contact((-80.0, 0.0))) == {"ROE-07"}


def test_passing_by_or_leaving_a_zone_is_none_but_crossing_it_between_two_looks_is() -> None:
    assert posed(DRONE, westward(-20.0, -25.0, -30.5, y=25.0)) == set()
    assert posed(DRONE, westward(-40.0, -35.0, -25.0, y=25.0)) == set()
    assert posed(DRONE, [(-29.0, 25.0), (-59.0, 25.0)]) == {"ROE-07"}
