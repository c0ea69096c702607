"""What is old, silent, forged or unknown never looks fine; large sites stay readable."""

import pytest
from textual.widgets import Input

from pa_console.schema.events import event as ev
from pa_console.schema.incident import unknown_name
from pa_console.schema.telemetry import CameraReport, GateCover
from pa_console.tui.controllers.commands import what_ifs
from pa_console.tui.map.canvas import Canvas
from pa_console.tui.map.scene import ROLES, MapScene
from pa_console.tui.status_words import Reliance
from pa_console.tui.widgets.assets import AssetPane, AssetTable, track_cells, track_words
from pa_console.tui.widgets.bars import StatusBar
from pa_console.tui.widgets.map_view import LEGEND, MapView
from pa_console.tui.widgets.row_views import NOTES
from tests.tui import crowd, living
from tests.tui.scripted import Show, press, settle
from tests.tui.site import WORLD, picture, track
from tests.tui.test_mission import shown

SCENE = MapScene(WORLD)
LARGE = crowd.world(1000, 50)


def drawn(width: int = 80, height: int = 24, **fields: object) -> str:
    given = picture().model_copy(update=fields) if fields else living.seen_picture()
    return "\n".join(SCENE.draw(given, width, height).lines())


def roles(width: int = 80, height: int = 24) -> set[str]:
    canvas = SCENE.draw(living.seen_picture(), width, height)
    return {role for row in canvas.roles for role in row}


def test_unreliable_reports_are_marked_with_sign_and_age_on_the_map() -> None:
    text = drawn()
    for words in ("D1 7s", "R2 22s", "U2≠", "?2 9s?", "■‼4"):
        assert words in text
    assert "▿✘" in text or "✘▿" in text
    assert {"stale", "suspect", "track-stale", "track-hostile", "camera-failed"} <= roles()


def test_a_gate_of_unknown_cover_is_neither_covered_nor_uncovered() -> None:
    def sign(cover: GateCover) -> str:
        gates = {"EastGate": cover}
        canvas = SCENE.draw(picture().model_copy(update={"gates": gates, "assets": {}}), 80, 24)
        return next(role for row in canvas.roles for role in row if role.startswith("gate-"))

    unsure = GateCover(covered=False, unsure=("Ugv_T01",))
    assert sign(unsure) == "gate-unknown"
    assert sign(GateCover(covered=False)) == "gate-uncovered"
    assert sign(GateCover(covered=True)) == "gate-covered"


def test_a_disputed_identity_says_who_says_what() -> None:
    claims = {"Robot_T01": "authorized", "Cam_West": "hostile"}
    seen = track("Track_07", identity_claims=claims, hostile_by=("Cam_West",))
    site = picture().model_copy(update={"tracks": {seen.id: seen}})
    look = Reliance(site, WORLD.stale_s)
    cells = track_cells(seen, look)
    assert "DISPUTED: R1 authorized, C1 hostile" in cells[NOTES][0]
    assert "disputed" in track_words(seen, look)


def test_an_uncertain_position_is_written_as_such() -> None:
    vague = track("Track_07", uncertainty_m=14.0)
    assert "■?7 ±14" in drawn(tracks={vague.id: vague})


def test_a_track_keeps_its_number_when_another_is_dropped() -> None:
    second = track("Track_02", "SouthGate", position=(0.0, -60.0))
    assert "■?2" in drawn(tracks={second.id: second})


def test_a_camera_that_is_not_heard_of_is_unknown() -> None:
    old = CameraReport(gate="NorthGate", works=True, stamp_s=280.0)
    assert "▿?" in drawn(cameras={"NorthCamera": old})


def test_every_sign_of_the_legend_is_a_role_of_the_map() -> None:
    assert {role for _, _, role in LEGEND} <= set(ROLES)


async def test_the_table_names_age_and_doubt_of_every_report(show: Show) -> None:
    async with show(living.troubled(), size=(80, 24)) as (app, pilot, _, _):
        await press(pilot, "escape", "f3")
        text = shown(app, "#assets")
        for words in ("? stale 7 s", "✘ silent", "22 s!", "≠ SUSPECT", "▿ works", "✘ FAILED",
                      "‼ HOSTILE", "by U1, E1", "WestGate?", "not in view"):  # fmt: skip
            assert words in text
        assert "? WestGate cover unknown" in str(app.screen.query_one(StatusBar).render())


async def test_problems_come_first_and_can_be_shown_alone(show: Show) -> None:
    async with show(living.troubled(), size=(80, 24)) as (app, pilot, _, _):
        table = app.screen.query_one(AssetTable)
        assets = [key for key in table.keys if key in WORLD.assets]
        assert assets[:4] == ["Ugv_T02", "Robot_T02", "Drone_T01", "Drone_T04"]
        await press(pilot, "escape", "F")
        assert [key for key in table.keys if key in WORLD.assets] == assets[:4]
        assert "filter" in str(app.screen.query_one(AssetPane).border_title)
        await press(pilot, "F")
        assert [key for key in table.keys if key in WORLD.assets] == assets


FILTERS = {
    "uav northgate": ["Drone_T02"],
    "Robot silent": ["Robot_T02"],
    "hostile": ["Track_04"],
    "camera failed": ["WestCamera"],
    "[b]": [],
}


async def test_a_filter_of_any_words_is_typed_and_cleared(show: Show) -> None:
    async with show(living.troubled(), size=(80, 24)) as (app, pilot, _, _):
        await pilot.press("escape", "f")
        table = app.screen.query_one(AssetTable)
        for words, left in FILTERS.items():
            app.screen.query_one("#asset-filter", Input).value = words
            await settle(pilot)
            assert [key for key in table.keys if key] == left
        await press(pilot, "enter", "escape")
        assert len([key for key in table.keys if key]) == 15


async def test_a_thousand_assets_are_shown_in_crowds_and_rows_on_demand(show: Show) -> None:
    async with show(crowd.opening(LARGE), world=LARGE) as (app, pilot, _, _):
        text = app.screen.query_one(MapView).text()
        assert sum(text.count(str(number)) for number in range(2, 10)) >= 20
        assert "Gate07" in text
        table = app.screen.query_one(AssetTable)
        assert table.count.total == 1051
        await press(pilot, "f3", "end")
        assert table.scroll_offset.y > 900
        await press(pilot, "home")
        assert table.scroll_offset.y == 0


def crowds(canvas: Canvas) -> int:
    """How many cells show a number of assets."""
    return sum(len(ids) > 1 for ids in canvas.marks.values())


def test_an_asset_in_trouble_is_told_within_its_crowd() -> None:
    given = crowd.crowd(LARGE)
    canvas = MapScene(LARGE).draw(given, 100, 30)
    assert any(f"{count}✘" in "".join(canvas.lines()) for count in range(2, 10))
    nearer = MapScene(LARGE).draw(given, 100, 30, (8.0, LARGE.frames["Gate07"].at))
    assert crowds(nearer) < crowds(canvas)


async def test_only_rows_that_changed_are_laid_out_again(show: Show) -> None:
    async with show(crowd.opening(LARGE), world=LARGE) as (app, pilot, station, _):
        table = app.screen.query_one(AssetTable)
        asked: list[int] = []
        row = table.row

        def counted(index: int, width: int) -> object:
            asked.append(index)
            return row(index, width)

        table.row = counted  # pyright: ignore[reportAttributeAccessIssue]
        station.emit(ev.TelemetryReceived(picture=crowd.crowd(LARGE, 300.5)), mission=None)
        await settle(pilot)
        assert 0 < len(asked) < 60


async def test_the_map_zooms_pans_and_comes_back(show: Show) -> None:
    async with show(living.troubled()) as (app, pilot, _, _):
        view = app.screen.query_one(MapView)
        whole = view.text()
        await pilot.press("escape", "full_stop", "full_stop", "shift+left")
        assert "×4" in str(view.border_title)
        assert view.text() != whole
        await pilot.press("comma", "comma", "comma")
        assert view.text() == whole


@pytest.mark.parametrize("world", [WORLD, crowd.world(3, 1)], ids=["site", "small"])
def test_every_what_if_names_only_what_the_world_has(world: crowd.World) -> None:
    offered = list(what_ifs(world))
    assert all(unknown_name(incident, world) == ("", "") for _, incident in offered)
    assert len({title for title, _ in offered}) == len(offered)
    kinds = {incident.kind for _, incident in offered}
    assert {"spawn", "jam", "weather", "spoof", "sensor", "gps", "phantom", "radio"} <= kinds
