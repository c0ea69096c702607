"""Metres become degrees and are metres again, to a centimetre at the size of a checkpoint."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from pa_console.schema.world import Origin
from pa_console.sim.worlds.geography import Geography

CENTIMETRE = 0.01
SEMI_MAJOR_M, FLATTENING = 6_378_137.0, 1 / 298.257223563
"""The ellipsoid of WGS-84."""


def metres(most: float) -> st.SearchStrategy[float]:
    return st.floats(-most, most)


origins = st.builds(
    Origin,
    latitude=st.floats(-89.0, 89.0),
    longitude=st.floats(-180.0, 180.0),
    bearing=st.floats(0.0, 359.0),
    altitude=st.none() | st.floats(-400.0, 8000.0),
)


@given(origins, metres(1000.0), metres(1000.0))
def test_there_and_back_is_the_same_place(origin: Origin, x: float, y: float) -> None:
    geography = Geography(origin)
    back = geography.metres(*geography.degrees((x, y)))
    assert math.dist(back, (x, y)) < CENTIMETRE


@given(st.floats(-45.0, 45.0), st.floats(-179.0, 179.0), metres(120.0), metres(120.0))
def test_a_degree_is_as_long_as_the_ellipsoid_says(
    latitude: float, longitude: float, x: float, y: float
) -> None:
    found = Geography(Origin(latitude=latitude, longitude=longitude)).degrees((x, y))
    squared = FLATTENING * (2 - FLATTENING)
    bulge = 1 - squared * math.sin(math.radians(latitude)) ** 2
    across, along = SEMI_MAJOR_M / bulge**0.5, SEMI_MAJOR_M * (1 - squared) / bulge**1.5
    north = math.radians(found[0] - latitude) * along
    east = math.radians(found[1] - longitude) * across * math.cos(math.radians(latitude))
    assert math.dist((east, north), (x, y)) < CENTIMETRE


@pytest.mark.parametrize(
    ("bearing", "north", "east"), [(0.0, 1, 0), (90.0, 0, 1), (180.0, -1, 0), (270.0, 0, -1)]
)
def test_the_bearing_turns_the_world(bearing: float, north: int, east: int) -> None:
    origin = Origin(latitude=2.0, longitude=-30.0, bearing=bearing)
    latitude, longitude = Geography(origin).degrees((0.0, 100.0))
    assert (round((latitude - 2.0) / 0.0009), round((longitude + 30.0) / 0.0009)) == (north, east)
    assert Geography(origin).course(90.0) == bearing, "the y axis points where the bearing says"
    assert Geography(origin).course(0.0) == (bearing + 90.0) % 360.0


@pytest.mark.parametrize(
    ("field", "value"),
    [("latitude", 90.1), ("longitude", -181.0), ("bearing", 360.0), ("altitude", 1e5)],
)
def test_an_origin_that_is_nowhere_is_refused(field: str, value: float) -> None:
    with pytest.raises(ValidationError, match=field):
        Origin(**{"latitude": 0.0, "longitude": 0.0} | {field: value})
