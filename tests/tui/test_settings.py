"""The settings screen, and the console that follows what was chosen there."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from textual.pilot import Pilot
from textual.widgets import Input, OptionList, Select, Static

from pa_console.settings.sources import load_settings
from pa_console.tui.actions import ACTIONS, KeymapError, check_keys, key_names
from pa_console.tui.approval.panel import ApprovalPanel
from pa_console.tui.screens.manual import HelpScreen
from pa_console.tui.screens.policies import PolicyScreen
from pa_console.tui.screens.settings import SettingsScreen
from pa_console.tui.theme import DEFAULT_THEME
from pa_console.tui.widgets.bars import StatusBar
from pa_console.tui.widgets.row_views import TextRows
from tests.tui import story
from tests.tui.scripted import ScriptedStation, Show, console, press, settle

Compare = Callable[..., bool]
SIZE = (120, 36)


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's settings file, which is not there yet."""
    path = tmp_path / "settings.yaml"
    monkeypatch.setenv("PA_CONSOLE_SETTINGS", str(path))
    return path


async def opened(pilot: Pilot[Any], station: ScriptedStation, row: str) -> SettingsScreen:
    """Open the settings and put the pointer on `row`."""
    await settle(pilot)
    await press(pilot, "escape", "O")
    screen = pilot.app.screen
    assert isinstance(screen, SettingsScreen)
    listing = screen.query_one(OptionList)
    listing.highlighted = listing.get_option_index(row)
    await settle(pilot)
    return screen


def note(screen: SettingsScreen) -> str:
    """What the screen says below the field."""
    return str(screen.query_one("#setting-note", Static).render())


async def test_a_value_is_checked_while_it_is_typed_and_saved_with_enter(
    file: Path, show: Show
) -> None:
    file.write_text("# mine\nspeed: 2\n")
    async with show(story.told("executing")) as (app, pilot, station, _):
        screen = await opened(pilot, station, "approval_delay_s")
        help_text = str(screen.query_one(TextRows).render())
        assert "from 0.2 to 10" in help_text
        await pilot.press("enter")
        screen.query_one(Input).value = "11"
        await settle(pilot)
        assert "✘" in note(screen)
        await press(pilot, "enter")
        assert "not saved" in note(screen)
        assert file.read_text() == "# mine\nspeed: 2\n"
        screen.query_one(Input).value = "1.5"
        await settle(pilot)
        assert "✔" in note(screen)
        await press(pilot, "enter")
        assert file.read_text() == "# mine\nspeed: 2\napproval_delay_s: 1.5\n"
        assert "in force now" in note(screen)
        assert app.session.main is not None
        assert app.session.main.query_one(ApprovalPanel).arm_delay_s == 1.5
        await press(pilot, "delete")
        assert file.read_text() == "# mine\nspeed: 2\n"
        await press(pilot, "enter", "7", "escape")
        assert screen.query_one(Input).value == "0.6"
        assert app.screen is screen
        await press(pilot, "escape")
        assert app.screen is app.session.main
        assert file.read_text() == "# mine\nspeed: 2\n"


async def test_a_theme_is_shown_at_once_and_what_is_not_in_force_yet_is_told(
    file: Path, monkeypatch: pytest.MonkeyPatch, show: Show
) -> None:
    monkeypatch.setenv("PA_CONSOLE_SPEED", "4")
    async with show(story.opening()) as (app, pilot, station, _):
        screen = await opened(pilot, station, "theme")
        screen.query_one(Select).value = "pa-console-light"
        await settle(pilot)
        assert app.theme == "pa-console-light"
        assert load_settings().values.theme == "pa-console-light"
        assert "in force now" in note(screen)
        screen.query_one(Select).clear()
        await settle(pilot)
        assert app.theme == DEFAULT_THEME
        assert "back to the default" in note(screen)
        listing = screen.query_one(OptionList)
        listing.highlighted = listing.get_option_index("speed")
        await settle(pilot)
        help_text = str(screen.query_one(TextRows).render())
        assert "PA_CONSOLE_SPEED" in help_text
        assert "from the next start" in help_text
        await pilot.press("enter")
        screen.query_one(Input).value = "2"
        await press(pilot, "enter")
        assert "PA_CONSOLE_SPEED overrides it" in note(screen)
        assert "speed: 2.0" in file.read_text()


async def test_a_key_is_moved_and_the_help_shows_it(file: Path, show: Show) -> None:
    async with show(story.told("executing")) as (app, pilot, station, _):
        screen = await opened(pilot, station, "keys.stop")
        await pilot.press("enter")
        screen.query_one(Input).value = "f8"
        await settle(pilot)
        assert "F8 is the key of cancel" in note(screen)
        screen.query_one(Input).value = "f11"
        await press(pilot, "enter")
        await press(pilot, "escape", "f9")
        assert station.stopped == 0
        await press(pilot, "f11")
        assert station.stopped == 1
        await press(pilot, "f1")
        assert isinstance(app.screen, HelpScreen)
        assert "F11 S" in str(app.screen.query_one(TextRows).render())


async def test_what_was_chosen_is_in_force_from_the_start(file: Path, show: Show) -> None:
    file.write_text("theme: pa-console-light\nstale_after_s: 20\nkeys: {stop: f11}\n")
    async with show(story.told("executing")) as (app, pilot, station, _):
        assert app.theme == "pa-console-light"
        assert app.session.main is not None
        assert app.session.main.query_one(StatusBar).stale_after_s == 20.0
        await press(pilot, "f11")
        assert station.stopped == 1


async def test_what_cannot_be_used_does_not_keep_the_console_from_starting(
    tmp_path: Path, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file.write_text("theme: nowhere\nkeys: {stop: f8}\n")
    station = ScriptedStation(story.opening())
    app = console(station, tmp_path)
    told: list[str] = []

    def tell(text: str, title: str, bad: bool = False) -> None:
        told.append(text)

    monkeypatch.setattr(app.session, "tell", tell)
    async with app.run_test(size=SIZE) as pilot:
        await settle(pilot)
        assert app.theme == DEFAULT_THEME
        assert [f"{file}:{line}: " in text for line, text in enumerate(told, 1)] == [True, True]
        await press(pilot, "f6")
        assert isinstance(app.screen, PolicyScreen)


@pytest.mark.parametrize(
    ("keymap", "says"),
    [
        ({"stopp": "f11"}, "did you mean stop"),
        ({"stop": "f8"}, "F8 is the key of cancel"),
        ({"stop": "a"}, "the approval panel"),
        ({"stop": "enter"}, "needed to move"),
        ({"stop": "f99"}, "“f99” is not a key"),
        ({"stop": ""}, "expected key names"),
        ({"stop": "f11", "cancel": "f11"}, "F11 is the key of"),
        ({"stop": "f11,S"}, "S is the key of stop.also"),
    ],
)
def test_keys_that_cannot_be_used_are_refused(keymap: dict[str, str], says: str) -> None:
    with pytest.raises(KeymapError, match=says):
        check_keys(keymap)


def test_the_consoles_own_keys_are_good_and_two_can_be_swapped() -> None:
    check_keys({})
    check_keys({"stop": "f8", "cancel": "f9"})
    check_keys({"stop": "ctrl+x,f11", "zoom_in": "+", "faster": "*"})
    assert {name.removesuffix(".also") for name in key_names()} == {a.id for a in ACTIONS}


def test_the_screen(snap_compare: Compare, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PA_CONSOLE_SETTINGS", "settings.yaml")
    monkeypatch.delenv("PA_CONSOLE_CACHE", raising=False)
    Path("settings.yaml").write_text("speed: 2\n")
    station = ScriptedStation(story.opening())
    app = console(station, tmp_path)

    async def run(pilot: Pilot[Any]) -> None:
        screen = await opened(pilot, station, "approval_delay_s")
        await pilot.press("enter")
        screen.query_one(Input).value = "11"
        await settle(pilot)

    assert snap_compare(app, terminal_size=(80, 24), run_before=run)
