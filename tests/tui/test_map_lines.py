"""Lines and details on the map: ways, fields of view, batteries, links, and a scale that stays."""

from pa_console.schema.events import event as ev
from pa_console.tui.map.scene import MapScene, outline
from pa_console.tui.widgets.map_view import TRAIL_S, MapView, Trails, scale_bar
from tests.tui import crowd, living
from tests.tui.scripted import Show, settle
from tests.tui.site import WORLD, picture

SCENE = MapScene(WORLD)
WALL = (((10.0, -80.0), (10.0, 80.0)),)


def flying(*times: float) -> Trails:
    """The trails after pictures at these times, in which a drone flies east at 4 m/s."""
    trails = Trails()
    for time_s in times:
        place = {"position": (4.0 * (time_s - 300.0), 25.0), "at": None}
        trails.add(picture(time_s, changes={"Drone_T04": place}))
    return trails


def roles(**options: object) -> list[str]:
    """The roles of all cells of a map of the default picture."""
    canvas = SCENE.draw(picture(), 116, 38, **options)  # pyright: ignore[reportArgumentType]
    return [role for row in canvas.roles for role in row]


def text(**changes: object) -> str:
    """The map when Ugv_T02 has reported these changes."""
    place = {"position": (30.0, 20.0), "at": None}
    return "\n".join(SCENE.draw(picture(changes={"Ugv_T02": place | changes}), 116, 38).lines())


def test_a_trail_is_the_way_that_was_flown() -> None:
    (way,) = flying(300.0, 301.0, 302.0)
    assert way == [(0.0, 25.0), (4.0, 25.0), (8.0, 25.0)]
    assert roles(trails=[way]).count("trail") >= 2
    assert "trail" not in roles()


def test_a_trail_is_short_and_what_stands_has_none() -> None:
    (way,) = flying(*(300.0 + n for n in range(60)))
    assert way[-1] == (4.0 * 59, 25.0)
    assert way[0][0] >= 4.0 * (58 - TRAIL_S)


def test_no_trail_crosses_a_jump_in_time() -> None:
    assert list(flying(300.0, 301.0, 400.0)) == []
    assert list(flying(300.0, 301.0, 200.0)) == []


def test_a_large_team_has_no_trails() -> None:
    site, trails = crowd.world(1000, 50), Trails()
    for time_s in (300.0, 301.0):
        trails.add(crowd.crowd(site, time_s))
    assert list(trails) == []


def test_fields_of_view_are_shown_on_demand() -> None:
    assert not {"camera-field", "asset-field"} & set(roles())
    assert "asset-field" not in roles(sensors="cameras")
    assert roles(sensors="cameras").count("camera-field") > 20
    assert roles(sensors="all").count("asset-field") > 20


def test_a_wall_cuts_a_field_of_view() -> None:
    free = outline((0.0, 0.0), 0.0, 60.0, 90.0, walls=())
    cut = outline((0.0, 0.0), 0.0, 60.0, 90.0, walls=WALL)
    assert free[0] == free[-1] == cut[0] == (0.0, 0.0)
    assert max(x for x, _ in free) > 59.0
    assert max(x for x, _ in cut) < 10.1
    around = outline((0.0, 0.0), 0.0, 60.0, 360.0, walls=WALL)
    assert min(x for x, _ in around) < -59.0
    assert max(x for x, _ in around) < 10.1


def test_battery_and_link_stand_at_the_marker() -> None:
    assert "U2 87%" in text()
    assert "U2 ◐ 87%" in text(comms="degraded")
    assert "U2 12%▼" in text(battery_pct=12.0, low_battery=True)
    assert "U2 12%▼◐" in text(battery_pct=12.0, low_battery=True, comms="degraded")


def test_the_scale_is_a_round_number_of_metres() -> None:
    assert scale_bar(1.0) == "├───┤ 5 m"
    assert scale_bar(0.5) == "├───┤ 10 m"
    assert scale_bar(0.012) == "├────┤ 500 m"


async def test_the_scale_stays_when_alarms_come_up(show: Show) -> None:
    async with show(living.troubled()[:3]) as (app, pilot, station, _):
        view = app.screen.query_one(MapView)
        before = view.text(), view.content_size
        station.emit(*(ev.AlarmRaised(alarm=alarm) for alarm in living.ALARMS), mission=None)
        await settle(pilot)
        assert app.screen.query_one("#alarms").display
        assert (view.text(), view.content_size) == before


async def test_the_key_shows_cameras_then_all_then_nothing(show: Show) -> None:
    async with show(living.troubled(), size=(200, 60)) as (app, pilot, _, _):
        view = app.screen.query_one(MapView)
        plain = view.text()
        await pilot.press("escape", "v")
        assert "camera's view" in view.text()
        assert "asset's view" not in view.text()
        await pilot.press("v")
        assert "asset's view" in view.text()
        await pilot.press("v")
        assert view.text() == plain
