"""A console that begins with a comparison."""

from pa_console.session.recording import Player
from pa_console.tui.app import comparison
from pa_console.tui.recordings import OpenedLog
from pa_console.tui.screens.compare import CompareScreen
from tests.tui import story
from tests.tui.scripted import Show, press
from tests.tui.site import WORLD
from tests.tui.story import stamped


async def test_escape_leads_from_the_comparison_to_the_first_recording(show: Show) -> None:
    a, b = (
        Player.of(stamped(story.told("approval", **options)))
        for options in ({}, {"broken": ("CAP-04",)})
    )
    opening = comparison(
        OpenedLog("a", a.recording, WORLD, {}), OpenedLog("b", b.recording, WORLD, {})
    )
    async with show(None, player=a, opening=opening) as (app, pilot, _, _):
        assert isinstance(app.screen, CompareScreen)
        await press(pilot, "escape")
        assert app.screen is app.session.main
        await pilot.press("q")
        await pilot.pause()
    assert app.return_code == 0
