"""The drawn map: everything on it once, nothing outside, whatever the size."""

from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.schema.telemetry import AssetTelemetry
from pa_console.tui.map.canvas import Blocks, Canvas, Projection, Strokes, touched
from pa_console.tui.map.markers import arrow
from pa_console.tui.map.scene import MapScene
from pa_console.tui.status_words import short_names
from tests.tui.site import WORLD, picture, track

SCENE = MapScene(WORLD)


@given(st.integers(40, 200), st.integers(12, 60))
@settings(max_examples=30, deadline=None)
def test_every_asset_track_and_gate_is_on_the_map(width: int, height: int) -> None:
    canvas = SCENE.draw(picture(tracks=(track(),)), width, height)
    text = "\n".join(canvas.lines())
    for name in SCENE.short.values():
        assert text.count(name) == 1
    assert "■?1" in text
    assert text.count("◆") == len(WORLD.gates)
    assert len(canvas.lines()) == height
    assert {len(line) for line in canvas.lines()} == {width}


@given(st.integers(1, 250), st.integers(1, 80))
@settings(max_examples=40, deadline=None)
def test_no_size_is_too_small_to_draw(width: int, height: int) -> None:
    canvas = SCENE.draw(picture(tracks=(track(),), uncovered=("EastGate",)), width, height)
    assert {len(line) for line in canvas.lines()} == {width}


def test_assets_on_one_spot_do_not_hide_each_other() -> None:
    names = list(WORLD.assets)
    changes = {name: {"position": (0.0, 0.0)} for name in names}
    text = "\n".join(SCENE.draw(picture(changes=changes), 80, 30).lines())
    assert all(SCENE.short[name] in text for name in names)


def test_an_uncovered_gate_differs_in_sign_not_only_in_colour() -> None:
    lines = SCENE.draw(picture(uncovered=("EastGate",)), 80, 24).lines()
    text = "\n".join(lines)
    assert (text.count("◇"), text.count("◆")) == (1, 3)


def test_an_asset_that_is_down_shows_no_heading() -> None:
    failed = {"Drone_T01": {"status": "failed"}, "Ugv_T01": {"comms": "lost"}}
    text = "\n".join(SCENE.draw(picture(changes=failed), 80, 24).lines())
    assert "D1✘" in text or "✘D1" in text
    assert "U1 0s" in text


def test_a_route_is_dotted_up_to_its_end() -> None:
    def dots(**changes: object) -> int:
        drawn = SCENE.draw(picture(changes={"Robot_T02": changes}), 100, 36)
        return sum(row.count("route") for row in drawn.roles)

    assert dots() == 0
    assert dots(route=((30.0, -36.0), (0.0, -36.0))) > 5


@given(st.tuples(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0)))
def test_a_line_touches_cells_without_a_gap(end: tuple[float, float]) -> None:
    start = 10.5, 10.5
    path = list(touched(start, (start[0] + end[0], start[1] + end[1]), 20, 20))
    assert path[0] == (10, 10)
    assert abs(path[-1][0] + 0.5 - start[0] - end[0]) <= 0.5
    assert abs(path[-1][1] + 0.5 - start[1] - end[1]) <= 0.5
    steps = pairwise(path)
    assert all(max(abs(a[0] - b[0]), abs(a[1] - b[1])) <= 1 for a, b in steps)


def test_walls_are_quarters_and_lines_are_eighths_of_a_cell() -> None:
    canvas = Canvas(4, 2)
    walls, lines = Blocks(), Strokes()
    walls.path([(0.2, 0.2), (1.9, 0.2), (1.9, 1.9)])
    lines.path([(3.2, 0.1), (3.2, 1.9)])
    walls.draw(canvas, "wall")
    lines.draw(canvas, "route")
    assert canvas.lines() == ["▀▜ ⡇", " ▐ ⡇"]


def test_north_is_up_and_east_is_right() -> None:
    view = Projection(WORLD, 80, 30)
    assert view.cell((0.0, 40.0))[1] < view.cell((0.0, -40.0))[1]
    assert view.cell((60.0, 0.0))[0] > view.cell((-60.0, 0.0))[0]
    assert [arrow(heading) for heading in (0, 90, 180, 270, -45)] == ["→", "↑", "←", "↓", "↘"]


def test_short_names_are_never_shared() -> None:
    assert short_names(["Drone_T01", "Ugv_T02"]) == {"Drone_T01": "D1", "Ugv_T02": "U2"}
    clashing = short_names(["Drone_A1", "Drone_B1", "Dog"])
    assert len(set(clashing.values())) == 3


def test_only_changed_rows_are_painted_again() -> None:
    def moved(asset: AssetTelemetry) -> dict[str, object]:
        return {"position": (asset.position[0] - 6.0, asset.position[1])}

    first = picture()
    second = picture(changes={"Drone_T03": moved(first.assets["Drone_T03"])})
    before, after = SCENE.draw(first, 80, 30), SCENE.draw(second, 80, 30)
    changed = [row for row in range(30) if before.runs(row) != after.runs(row)]
    assert 1 <= len(changed) <= 3


@pytest.mark.parametrize(("width", "height"), [(80, 6), (80, 7), (60, 9), (40, 12), (110, 36)])
def test_a_place_s_name_stands_there_whole_or_not_at_all(width: int, height: int) -> None:
    canvas = SCENE.draw(picture(), width, height)
    for row in range(height):
        for text, role in canvas.runs(row):
            if role == "label":
                assert set(text.split()) <= set(WORLD.frames), text
