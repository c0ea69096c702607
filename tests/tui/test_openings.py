"""A console that begins with a comparison."""

from pathlib import Path

from pa_console.session.recording import Player
from pa_console.tui.app import comparison
from pa_console.tui.screens.compare import CompareScreen, Side
from tests.tui import story
from tests.tui.scripted import console, settle
from tests.tui.site import WORLD
from tests.tui.story import stamped


async def test_escape_leads_from_the_comparison_to_the_first_recording(tmp_path: Path) -> None:
    a, b = (
        Player.of(stamped(story.told("approval", **options)))
        for options in ({}, {"broken": ("CAP-04",)})
    )
    opening = comparison(Side("a", a.recording, WORLD, {}), Side("b", b.recording, WORLD, {}))
    app = console(None, tmp_path, player=a, opening=opening)
    async with app.run_test(size=(120, 36)) as pilot:
        await settle(pilot)
        assert isinstance(app.screen, CompareScreen)
        await pilot.press("escape")
        await settle(pilot)
        assert app.screen is app.session.main
        await pilot.press("q")
        await pilot.pause()
    assert app.return_code == 0
