"""The recorded sessions on the screen: what each was, and what can be done with it."""

from pathlib import Path
from typing import Any

import pytest
from textual.pilot import Pilot
from textual.widgets import Static

from pa_console.settings.sources import load_settings
from pa_console.tui.app import ConsoleApp
from pa_console.tui.screens.compare import CompareScreen
from pa_console.tui.screens.recording import RecordingScreen
from pa_console.tui.screens.sessions import SessionRows, SessionsScreen
from pa_console.tui.widgets.row_views import TextRows
from tests.session.logs import write_log
from tests.tui import story
from tests.tui.scripted import ScriptedStation, console, notices, press, settle, until
from tests.tui.test_replay import happened, otherwise

pytestmark = pytest.mark.long


def opened(tmp_path: Path) -> tuple[ConsoleApp, ScriptedStation]:
    """A live console whose folder of logs has two sessions."""
    logs = tmp_path / "logs"
    logs.mkdir()
    write_log(logs / "one.jsonl", happened())
    write_log(logs / "two.jsonl", otherwise(), "S2")
    station = ScriptedStation(story.told("executing"))
    settings = load_settings({"logs": str(logs)})
    return console(station, tmp_path, settings=settings), station


async def look(pilot: Pilot[Any], station: ScriptedStation) -> SessionRows:
    """Open the screen of sessions and wait until every log was checked."""
    await settle(pilot)
    await pilot.press("escape", "L")
    assert isinstance(pilot.app.screen, SessionsScreen)
    listing = pilot.app.screen.query_one(SessionRows)
    await until(pilot, lambda: listing.keys and all(map(listing.standing, listing.keys)))
    await settle(pilot)
    return listing


def sheet(app: ConsoleApp) -> str:
    return str(app.screen.query_one("#list-sheet", TextRows).render())


@pytest.mark.parametrize("size", [(60, 18), (80, 24), (120, 36)])
async def test_every_session_is_listed_with_how_it_ended_and_whether_it_is_sound(
    tmp_path: Path, size: tuple[int, int]
) -> None:
    app, station = opened(tmp_path)
    async with app.run_test(size=size) as pilot:
        listing = await look(pilot, station)
        assert len(listing.keys) == 2
        title = str(app.screen.query_one("#list-title", Static).render())
        assert "2 recorded sessions" in title
        mission = story.MISSION.said
        assert listing.text.count(mission[:12]) == 2
        assert listing.text.count("not signed") == 2
        assert mission in " ".join(sheet(app).split())
        assert "verified" in sheet(app)
        await pilot.press("escape")
        assert app.screen is app.session.main


async def test_a_session_is_opened_and_one_comes_back_to_the_list(tmp_path: Path) -> None:
    app, station = opened(tmp_path)
    async with app.run_test(size=(80, 24)) as pilot:
        await look(pilot, station)
        await press(pilot, "enter")
        assert isinstance(app.screen, RecordingScreen)
        await pilot.press("escape")
        assert isinstance(app.screen, SessionsScreen)


async def test_two_sessions_are_compared_but_none_with_itself(tmp_path: Path) -> None:
    app, station = opened(tmp_path)
    async with app.run_test(size=(80, 24)) as pilot:
        listing = await look(pilot, station)
        await pilot.press("c", "c")
        assert "this is the same session" in notices(app)[-1]
        await pilot.press("escape")
        assert (listing.marked, isinstance(app.screen, SessionsScreen)) == ("", True)
        await press(pilot, "c", "down", "c")
        assert isinstance(app.screen, CompareScreen)


async def test_a_session_is_exported_with_all_its_missions(tmp_path: Path) -> None:
    app, station = opened(tmp_path)
    async with app.run_test(size=(80, 24)) as pilot:
        listing = await look(pilot, station)
        await press(pilot, "x")
        file = tmp_path / "copies" / f"{Path(listing.cursor).stem}-session.txt"
        assert story.MISSION.said in file.read_text()
        assert str(file) in notices(app)[-1]


async def test_a_session_whose_world_is_not_here_is_not_run_again_and_that_is_told(
    tmp_path: Path,
) -> None:
    app, station = opened(tmp_path)
    async with app.run_test(size=(80, 24)) as pilot:
        await look(pilot, station)
        await pilot.press("r")
        await until(pilot, lambda: "as it was in this session" in notices(app)[-1])


async def test_an_empty_folder_says_so_and_a_damaged_log_where(tmp_path: Path) -> None:
    app, station = opened(tmp_path)
    logs = tmp_path / "logs"
    (logs / "two.jsonl").unlink()
    whole = (logs / "one.jsonl").read_text()
    (logs / "one.jsonl").write_text(whole.replace("too far", "too near"))
    async with app.run_test(size=(120, 36)) as pilot:
        listing = await look(pilot, station)
        assert "DAMAGED" in listing.text
        assert "edited" in sheet(app)
        (logs / "one.jsonl").unlink()
        await pilot.press("f5")
        await until(pilot, lambda: not listing.keys)
        assert "No sessions have been recorded here yet." in sheet(app)
