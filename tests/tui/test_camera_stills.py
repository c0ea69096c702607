"""A still of a track, beside the plan that waits and on the track's card."""

from collections.abc import Callable
from pathlib import Path

import pytest

from pa_console.schema.events.event import ApprovalRequested, CameraStill, EventPayload
from pa_console.schema.plan import Plan
from pa_console.session.recording import Player
from pa_console.session.stills import stills_folder
from pa_console.tui.approval.panel import ApprovalPanel
from pa_console.tui.screens.compose import Card
from pa_console.tui.widgets.assets import AssetTable
from pa_console.tui.widgets.row_views import TextRows
from pa_console.tui.widgets.still import StillView
from tests.session.logs import write_log
from tests.stills import CAMERA, kept
from tests.tui import story
from tests.tui.scripted import FakeClock, ScriptedStation, Show, console, press, settle, until
from tests.tui.story import stamped
from tests.tui.test_snapshots import READINGS, SIZES, before

TRACK = "Vehicle_01"
NOTHING = ApprovalRequested(attempt=1, plan=Plan(reason="", actions=()), state="approve")


def plain(rows: TextRows) -> str:
    """Return what the rows say, in one line."""
    lines = rows.render_lines(rows.size.region)
    return " ".join(" ".join(line.text for line in lines).split())


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """The log beside which stills are kept."""
    return tmp_path / "session.jsonl"


@pytest.mark.parametrize("size", ["80x24", "120x36"])
def test_it_stands_beside_the_plan(
    snap_compare: Callable[..., bool], tmp_path: Path, log: Path, size: str
) -> None:
    station, clock = ScriptedStation([*story.told("approval"), kept(log, TRACK)]), FakeClock()
    app = console(station, tmp_path, clock, log=log)
    assert snap_compare(app, terminal_size=SIZES[size], run_before=before(station, clock, ()))


PLANS: dict[str, list[EventPayload]] = {
    "sure": story.told("approval"),
    "much to give": story.told("approval", broken=("CAP-04",), verdict="Failure"),
    "readings": story.told("approval", confidence=0.41, readings=READINGS),
    "nothing moves": [*story.told("planning"), NOTHING],
}


@pytest.mark.parametrize("name", list(PLANS))
async def test_the_commands_stay_in_the_panel_of_a_small_terminal(
    show: Show, log: Path, name: str
) -> None:
    told = [*PLANS[name], kept(log, TRACK)]
    async with show(told, size=(80, 24), log=log) as (app, _, _, _):
        panel, still = app.screen.query_one(ApprovalPanel), app.screen.query_one(StillView)
        assert still.size.height > 4
        assert panel.region.contains_region(still.region)
        for part in ("#approval-body", "#approval-buttons"):
            region = app.screen.query_one(part).region
            assert panel.region.contains_region(region)
            assert not region.overlaps(still.region)


async def test_a_key_pressed_as_it_appears_decides_nothing(show: Show, log: Path) -> None:
    async with show(story.told("approval"), log=log) as (app, pilot, station, clock):
        panel = app.screen.query_one(ApprovalPanel)
        clock.now += 1.0
        assert panel.armed
        station.emit(kept(log, TRACK))
        await settle(pilot)
        await pilot.press("a", "enter")
        assert station.decisions == []
        clock.now += 1.0
        station.emit(kept(log, TRACK, taken_s=299.0))  # another one of the same size
        await settle(pilot)
        assert panel.armed


async def test_it_tells_its_age(show: Show, log: Path) -> None:
    told = [*story.told("approval"), kept(log, TRACK, taken_s=story.PICTURE.time_s - 12.0)]
    async with show(told, log=log) as (app, _, _, _):
        assert "12 s ago" in app.screen.query_one(StillView).render().plain


@pytest.mark.parametrize("harm", ["changed", "gone", "other log"])
async def test_a_file_that_is_not_what_was_shown_is_not_shown(
    show: Show, log: Path, harm: str
) -> None:
    still = kept(log, TRACK)
    file = stills_folder(log) / still.file_name
    if harm == "changed":
        file.write_bytes(file.read_bytes()[:-20])
    elif harm == "gone":
        file.unlink()
    where = log if harm != "other log" else log.with_name("other.jsonl")
    async with show([*story.told("approval"), still], log=where) as (app, _, _, _):
        assert not app.screen.query_one(StillView).region.height


async def test_why_there_is_none_is_told(show: Show, log: Path) -> None:
    problem = CameraStill(track=TRACK, camera=CAMERA, taken_s=1.0, problem="no answer within 5 s")
    async with show([*story.told("approval"), problem], log=log) as (app, _, _, _):
        assert not app.screen.query_one(StillView).region.height
        text = plain(app.screen.query_one("#approval-text", TextRows))
        assert f"No still {CAMERA}, {TRACK}: no answer within 5 s" in text


async def test_a_track_s_card_shows_what_a_camera_sees(show: Show, log: Path) -> None:
    async with show(story.opening(), size=(80, 24), log=log) as (app, pilot, station, _):
        station.stills[TRACK] = kept(log, TRACK)
        await pilot.press("escape", "f3")
        app.screen.query_one(AssetTable).point_at(TRACK)
        await pilot.press("enter")
        await pilot.pause()
        assert isinstance(app.screen, Card)
        still = app.screen.query_one(StillView)
        await until(pilot, lambda: still.region.height)
        await settle(pilot)
        assert app.screen.region.contains_region(app.screen.query_one("#card").region)
        assert CAMERA in still.render().plain


async def test_a_recording_shows_what_was_shown(show: Show, log: Path) -> None:
    told = [*story.told("approval"), kept(log, TRACK)]
    write_log(log, stamped(told))
    async with show(None, player=Player.open(log)) as (app, pilot, _, _):
        await press(pilot, "G", *"end", "enter")
        assert app.screen.query_one(StillView).region.height
