"""Nothing on the map stands where it is not: markers, counts, leaders and names."""

from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from random import Random

from hypothesis import example, given, settings
from hypothesis import strategies as st
from shapely import LineString, MultiLineString, Point

from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World
from pa_console.tui.map.canvas import Canvas, Cell, Projection
from pa_console.tui.map.scene import MapScene
from tests.tui import crowd
from tests.tui.site import WORLD, picture, track

SCENE = MapScene(WORLD)
NAMES = tuple(WORLD.assets)
SIGNS = set("→↗↑↖←↙↓↘✘≠?")
CROWDED_WEST = (
    (-54.0, 0.0), (-52.0, 2.0), (-55.0, 3.0), (-51.0, -2.0), (-50.0, 1.0), (-53.0, -3.0),
    (-56.0, 5.0), (-49.0, 4.0),
)  # fmt: skip

sizes = st.tuples(st.integers(20, 200), st.integers(8, 60))
anywhere = st.tuples(st.floats(-75.0, 75.0), st.floats(-50.0, 50.0))
at_a_gate = st.tuples(st.floats(-62.0, -46.0), st.floats(-8.0, 14.0))
teams = st.lists(st.one_of(anywhere, at_a_gate), min_size=1, max_size=len(NAMES))
troubles = st.sampled_from(
    ({}, {"status": "failed"}, {"integrity": "suspect"}, {"stale": True, "available": False})
)


def placed(places: list[tuple[float, float]], trouble: dict[str, object]) -> Picture:
    """The default picture with a team of only so many, at these places."""
    named = dict(zip(NAMES, places, strict=False))
    changes = {
        name: {"position": place, "at": None} | (trouble if name == NAMES[0] else {})
        for name, place in named.items()
    }
    shown = picture(changes=changes, tracks=(track(),))
    return shown.model_copy(update={"assets": {name: shown.assets[name] for name in named}})


def barriers(world: World) -> MultiLineString:
    """Walls and the edges of the restricted zones, in metres."""
    zones = [(*zone.polygon, zone.polygon[0]) for zone in world.zones.values()]
    return MultiLineString([*((wall.start, wall.end) for wall in world.walls), *zones])


BARRIERS = barriers(WORLD)


def inside(cell: Cell, canvas: Canvas) -> Cell:
    """The cell itself, or the nearest one on the canvas."""
    column, row = cell
    return min(max(column, 0), canvas.width - 1), min(max(row, 0), canvas.height - 1)


def name_cells(canvas: Canvas, name: str) -> list[Cell]:
    """Every cell where a short name is written; a count in another word makes none."""
    found = [
        [(column + offset, row) for offset in range(len(name))]
        for row, line in enumerate(canvas.lines())
        for column in range(len(line))
        if line.startswith(name, column)
    ]
    return [cell for cells in found if canvas.marks.keys().isdisjoint(cells) for cell in cells]


def ways(canvas: Canvas, at: Cell) -> Iterator[list[Cell]]:
    """Every way from a marker along its leader to the cells of a name."""
    for cells in canvas.labels.get(at, ()):
        leader = [cell for cell in cells if canvas.role(cell) == "leader"]
        name, end = cells[len(leader) :], (leader or [at])[-1]
        first = min(name, key=lambda cell: abs(cell[0] - end[0]) + abs(cell[1] - end[1]))
        for cell in name:
            yield [*leader, first, cell]


@given(teams, sizes, troubles)
@example(list(CROWDED_WEST), (69, 13), {})
@example(list(CROWDED_WEST), (80, 17), {})
@settings(max_examples=250, deadline=None)
def test_every_marker_is_in_the_cell_of_its_asset(
    places: list[tuple[float, float]], size: tuple[int, int], trouble: dict[str, object]
) -> None:
    shown, view = placed(places, trouble), Projection(WORLD, *size)
    canvas = SCENE.draw(shown, *size)
    things = [*shown.assets.values(), *shown.tracks.values()]
    cells = {item.id: inside(view.cell(item.position), canvas) for item in things}
    counts = Counter(cells.values())
    for name, cell in cells.items():
        glyph = canvas.glyphs[cell[1]][cell[0]]
        assert name in canvas.marks[cell]
        beyond = cell not in {view.cell(thing.position) for thing in things}
        expected = SIGNS if beyond else {str(counts[cell])} if counts[cell] > 1 else SIGNS | {"■"}
        assert glyph in expected


@given(teams, sizes, troubles)
@example(list(CROWDED_WEST), (69, 13), {})
@example(list(CROWDED_WEST), (80, 17), {})
@example([(-46.0, 23.0), (-46.0, 23.0)], (45, 8), {})
@settings(max_examples=250, deadline=None)
def test_no_name_lies_on_or_beyond_a_wall_or_the_edge_of_a_zone(
    places: list[tuple[float, float]], size: tuple[int, int], trouble: dict[str, object]
) -> None:
    shown, view = placed(places, trouble), Projection(WORLD, *size)
    canvas = SCENE.draw(shown, *size)
    labelled = {cell for at in canvas.labels for cells in canvas.labels[at] for cell in cells}
    for name, asset in shown.assets.items():
        written = name_cells(canvas, SCENE.short[name])
        assert len(written) in (0, len(SCENE.short[name]))
        assert labelled.issuperset(written)
        at = inside(view.cell(asset.position), canvas)
        if not view.shows(asset.position) or not written:
            continue
        mine = [way for way in ways(canvas, at) if way[-1] in written]
        assert len(mine) == len(written)
        for way in mine:
            line = LineString([asset.position, *(view.centre(cell) for cell in way)])
            assert not line.intersects(BARRIERS)


@given(teams, sizes)
@settings(max_examples=120, deadline=None)
def test_a_leader_begins_at_its_marker_and_ends_at_the_name(
    places: list[tuple[float, float]], size: tuple[int, int]
) -> None:
    canvas = SCENE.draw(placed(places, {}), *size)
    for at, labels in canvas.labels.items():
        for cells in labels:
            leader = [cell for cell in cells if canvas.role(cell) == "leader"]
            name = cells[len(leader) :]
            for here, there in pairwise([at, *leader]):
                assert max(abs(here[0] - there[0]), abs(here[1] - there[1])) == 1
            end = leader[-1] if leader else at
            gap = min(max(abs(end[0] - c), abs(end[1] - r)) for c, r in name)
            assert gap <= (1 if leader else 2)
            assert not set(cells) & set(canvas.marks)


@given(teams, sizes)
@settings(max_examples=120, deadline=None)
def test_hatched_is_what_lies_in_the_zone_and_nothing_else(
    places: list[tuple[float, float]], size: tuple[int, int]
) -> None:
    view, canvas = Projection(WORLD, *size), SCENE.draw(None, *size)
    depot = Point(-44.0, 26.0)
    zone = LineString(WORLD.zones["Depot"].polygon).convex_hull
    for place in places:
        cell = view.cell(place)
        if (
            canvas.holds(cell)
            and canvas.role(cell) == "zone"
            and canvas.glyphs[cell[1]][cell[0]] == "╱"
        ):
            assert zone.contains(Point(place))
    assert zone.contains(depot)


def test_crowded_names_are_joined_to_their_markers() -> None:
    west = placed(list(CROWDED_WEST), {})
    for size in ((69, 13), (80, 17), (116, 38)):
        text = "\n".join(SCENE.draw(west, *size).lines())
        assert sum(SCENE.short[name] in text for name in NAMES) >= len(NAMES) - 1
    assert all(text.count(SCENE.short[name]) == 1 for name in NAMES)


def test_a_count_of_ten_and_more_is_a_plus_with_the_number_beside_it() -> None:
    site = crowd.world(30, 4)
    shown = crowd.crowd(site)
    here = {
        name: asset.model_copy(update={"position": (0.0, 0.0)})
        for name, asset in shown.assets.items()
    }
    canvas = MapScene(site).draw(shown.model_copy(update={"assets": here}), 100, 30)
    assert any("×30" in line for line in canvas.lines())
    assert [len(ids) for ids in canvas.marks.values()].count(30) == 1


def test_what_lies_beyond_the_view_is_an_arrow_at_its_edge() -> None:
    far = {"Drone_T04": {"position": (0.0, 400.0), "at": None}}
    lines = SCENE.draw(picture(changes=far), 80, 24).lines()
    assert "↑" in lines[0]
    assert "D4" in lines[0] + lines[1]


@given(st.randoms(use_true_random=False), st.integers(40, 150), sizes)
@settings(max_examples=25, deadline=None)
def test_every_cell_of_a_large_team_shows_how_many_are_in_it(
    random: Random, assets: int, size: tuple[int, int]
) -> None:
    site = crowd.world(assets, 8)
    shown, view = crowd.crowd(site), Projection(site, *size)
    spread = {
        name: asset.model_copy(
            update={"position": (random.gauss(0.0, 150.0), random.gauss(0.0, 100.0))}
        )
        for name, asset in shown.assets.items()
    }
    shown = shown.model_copy(update={"assets": spread, "tracks": {}})
    canvas = MapScene(site).draw(shown, *size)
    counts = Counter(view.cell(asset.position) for asset in spread.values())
    at_the_edge = Counter(inside(cell, canvas) for cell in counts if not canvas.holds(cell))
    for cell, count in counts.items():
        if canvas.holds(cell) and cell not in at_the_edge:
            glyph = canvas.glyphs[cell[1]][cell[0]]
            assert len(canvas.marks[cell]) == count
            assert glyph in (SIGNS if count == 1 else {str(count) if count < 10 else "+"})


def test_every_one_of_a_thousand_has_its_marker() -> None:
    site = crowd.world(1000, 50)
    shown = crowd.crowd(site)
    canvas = MapScene(site).draw(shown, 100, 30)
    found = [name for ids in canvas.marks.values() for name in ids]
    assert sorted(found) == sorted([*shown.assets, *shown.tracks])
