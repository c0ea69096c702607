"""The dim line under the mission field: what the order that is being typed reads as so far."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from textual.pilot import Pilot
from textual.widget import Widget
from textual.widgets import Footer

from pa_console.settings.sources import load_settings
from pa_console.tui.app import ConsoleApp
from pa_console.tui.widgets.mission_prompt import MissionPrompt, ReadingLine
from tests.tui import story
from tests.tui.scripted import FakeClock, Opened, ScriptedStation, Show, console, press, settle

ORDER = "Send a drone to the east gate"
READING = "reads as: Drone_T04 to East Gate; gates stay covered"
LONG = (
    "reads as: Drone_T04 to East Gate; not done: Robot_T01 to West Gate: it covers South Gate "
    "alone; gates stay covered"
)
SIZES = {"80x24": (80, 24), "120x36": (120, 36)}


def line(app: ConsoleApp) -> str:
    """The line as it is shown; '' while it is hidden."""
    assert app.session.main is not None
    shown = app.session.main.query_one(ReadingLine)
    return str(shown.render()) if shown.display else ""


async def typed(opened: Opened, text: str = ORDER) -> None:
    """Let a text stand in the prompt, and the console know of it."""
    main = opened.app.session.main
    assert main is not None
    main.query_one(MissionPrompt).put(text)
    await settle(opened.pilot)


async def reads(opened: Opened, reading: str = READING, text: str = ORDER) -> None:
    """Let the station give a reading."""
    show = opened.station.show_reading
    assert show is not None
    show(text, reading)
    await settle(opened.pilot)


@pytest.mark.parametrize(
    ("text", "keys", "shown"),
    [
        (ORDER, (), READING),
        ("Send a drone to the east", (), ""),
        (ORDER, ("x",), ""),
        (ORDER, ("space",), READING),
    ],
    ids=["of the text", "of another", "a key withdraws it", "a space does not"],
)
async def test_only_the_reading_of_what_stands_in_the_prompt_is_shown(
    text: str, keys: tuple[str, ...], shown: str, show: Show
) -> None:
    async with show(story.opening()) as opened:
        await typed(opened, f"  {ORDER} ")
        assert opened.station.typed.split() == ORDER.split()
        await reads(opened, text=text)
        await press(opened.pilot, *keys)
        assert line(opened.app) == shown


async def test_enter_sends_the_order_and_the_line_is_gone(show: Show) -> None:
    async with show(story.opening()) as opened:
        await typed(opened)
        await reads(opened)
        opened.clock.now += 5.0
        await press(opened.pilot, "enter")
        assert opened.station.submitted == [ORDER]
        assert opened.station.typed == ""
        assert line(opened.app) == ""


async def test_an_order_with_an_open_slot_is_not_read(show: Show) -> None:
    async with show(story.opening()) as opened:
        await typed(opened, "Send {drone} to look at NorthGate.")
        assert opened.station.typed == ""


async def test_nothing_moves_for_the_line(show: Show) -> None:
    async with show(story.opening()) as opened:
        await typed(opened)
        main = opened.app.session.main
        assert main is not None
        before = {each.id: each.region for each in main.walk_children(Widget) if each.id}
        await reads(opened, LONG)
        after = {each.id: each.region for each in main.walk_children(Widget) if each.id}
        assert before | {"live-reading": after["live-reading"]} == after
        assert after["live-reading"] == main.query_one(Footer).region
        assert after["live-reading"].height == 1


async def test_the_setting_switches_it_off_and_on_at_once(show: Show) -> None:
    async with show(story.opening()) as opened:
        assert opened.station.show_reading is not None
        use = opened.app.controllers.settings.use
        use(load_settings({"live_reading": "off"}))
        assert opened.station.show_reading is None
        use(load_settings({"live_reading": "on"}))
        assert opened.station.show_reading is not None


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("colour", ["colour", "no-colour"])
def test_how_it_looks(
    size: str,
    colour: str,
    snap_compare: Callable[..., bool],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if colour == "no-colour":
        monkeypatch.setitem(os.environ, "NO_COLOR", "1")
    station, clock = ScriptedStation(story.opening()), FakeClock()
    app = console(station, tmp_path, clock)

    async def before(pilot: Pilot[None]) -> None:
        await settle(pilot)
        opened = Opened(app, pilot, station, clock)
        await typed(opened)
        await reads(opened, LONG)

    assert snap_compare(app, terminal_size=SIZES[size], run_before=before)
