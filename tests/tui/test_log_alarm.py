"""A log that cannot be written is told in red on every screen, until it can be written again."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from textual.pilot import Pilot

from pa_console.schema.events import event as ev
from pa_console.session.recording import Player
from pa_console.tui.app import ConsoleApp
from pa_console.tui.approval.panel import ARM_DELAY_S
from pa_console.tui.screens.recording import RecordingScreen
from tests.tui import story
from tests.tui.scripted import Show, notices, press, settle
from tests.tui.site import WORLD
from tests.tui.story import stamped

FULL = "s.jsonl: cannot write the session log: No space left on device"
TOLD = ("LOG NOT WRITTEN", "nothing is dispatched", "no plan can be approved", "No space left")


def top_line(app: ConsoleApp) -> tuple[str, bool]:
    """Return the text of the two uppermost lines as they are painted, and whether on red."""
    rows = [app.screen._compositor.render_strips()[row] for row in range(2)]  # pyright: ignore[reportPrivateUsage]
    segments = [segment for row in rows for segment in row]
    text = " ".join("".join(segment.text for segment in segments).split())
    style = segments[1].style
    colour = style.bgcolor.triplet if style is not None and style.bgcolor is not None else None
    return text, colour is not None and colour.red > 2 * max(colour.green, colour.blue)


def open_recording(app: ConsoleApp) -> None:
    recorded = Player.of(stamped(story.told("finished")))
    app.push_screen(RecordingScreen(WORLD, {}, recorded, app.session.clock))


def carry_out(name: str) -> Callable[[ConsoleApp], object]:
    return lambda app: app.action_carry_out(name)


SCREENS: dict[str, Callable[[ConsoleApp], object]] = {
    "main": lambda _: None,
    "help": carry_out("help"),
    "manual": carry_out("manual"),
    "policies": carry_out("policies"),
    "settings": carry_out("settings"),
    "evaluation": carry_out("evaluation"),
    "palette": lambda app: app.action_command_palette(),
    "plan editor": lambda app: app.controllers.approval.modify(),
    "question": carry_out("quit"),
    "recording": open_recording,
}


async def shown_on(app: ConsoleApp, pilot: Pilot[Any], name: str) -> None:
    """Open a screen."""
    before = app.screen
    SCREENS[name](app)
    await settle(pilot)
    assert name == "main" or app.screen is not before


@pytest.mark.parametrize("first", ["trouble", "screen"])
async def test_every_screen_says_in_red_that_nothing_is_dispatched(
    tmp_path: Path, first: str, show: Show
) -> None:
    """One console opens one screen after the other, each of them without trouble at first."""
    async with show(story.told("approval"), evaluations=tmp_path) as (app, pilot, station, _):
        main = app.screen
        for name in SCREENS:
            assert "nothing is dispatched" not in top_line(app)[0], name
            if first == "screen":
                await shown_on(app, pilot, name)
            station.emit(ev.LogTroubled(problem=FULL), mission=None)
            await settle(pilot)
            if first == "trouble":
                await shown_on(app, pilot, name)
            text, red = top_line(app)
            assert all(words in text for words in TOLD), (name, text)
            assert red, name
            station.emit(ev.LogTroubled(problem=""), mission=None)
            await settle(pilot)
            assert "nothing is dispatched" not in top_line(app)[0], name
            while app.screen is not main:
                await app.pop_screen()
            await settle(pilot)


async def test_an_approval_that_is_refused_while_the_log_is_in_trouble_says_so(show: Show) -> None:
    async with show(story.told("approval")) as (app, pilot, station, clock):
        station.emit(ev.LogTroubled(problem=FULL), mission=None)
        station.refuse = f"no approval is possible while the log cannot be written: {FULL}"
        await settle(pilot)
        clock.now += ARM_DELAY_S
        await press(pilot, "a", "enter")
        assert station.decisions == []
        assert station.refuse in notices(app)
