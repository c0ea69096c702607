"""The manual in the console: its pages, the search over all of them, links, the way back."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from textual.pilot import Pilot
from textual.widgets import Input, Markdown, OptionList

from pa_console.manual_pages import Manual, load_manual, read_page
from pa_console.tui.screens.manual import HelpScreen, ManualScreen
from tests.tui import story
from tests.tui.scripted import ScriptedStation, Show, console, notices, press, settle, until

SIZES = {"80x24": (80, 24), "120x36": (120, 36)}
FILLING = "\n\n".join(f"Paragraph {number} says little." for number in range(40))
INDEX = """# Manual

It begins with the [rules](rules.md#signing) and *ends* with [nothing](nowhere.md).

| key | what it does |
|---|---|
| `F9` | stops all assets |
"""
RULES = f"""# Rules

A rule says what must hold.

{FILLING}

## Signing

Rules are signed with `pa-console rules sign`.

```
pa-console rules pin
```

{FILLING}
"""
CONSOLE = """# Console

The map is at the left.

## Alarms

An alarm is new or seen.
"""
TEXTS = {"index": INDEX, "rules": RULES, "console": CONSOLE}
MANUAL = Manual(read_page(name, text) for name, text in TEXTS.items())
Compare = Callable[..., bool]


async def opened(pilot: Pilot[Any], *keys: str) -> ManualScreen:
    """Open a manual of the test's own and press `keys`."""
    screen = ManualScreen(MANUAL)
    await pilot.app.push_screen(screen)
    await shown(pilot, screen)
    for key in keys:
        await pilot.press(key)
        await pilot.pause()
    await shown(pilot, screen)
    return screen


async def shown(pilot: Pilot[Any], screen: ManualScreen) -> None:
    """Wait until the page that is wanted is laid out."""
    await settle(pilot)
    await until(pilot, lambda: not any(work.group == "manual" for work in screen.workers))
    await settle(pilot)


def title(screen: ManualScreen) -> str:
    """The title of the page that is shown."""
    return screen.query_one(Markdown).table_of_contents[0][1]


def marked(screen: ManualScreen) -> list[str]:
    """The headings that are marked, all of which can be seen."""
    page, text = screen.query_one("#manual-page"), screen.query_one(Markdown)
    names = {block.id for block in text.query(".-found") if block.region in page.region}
    return [words for _, words, name in text.table_of_contents if name in names]


async def test_the_manual_opens_from_the_help_page_and_escape_goes_back(show: Show) -> None:
    async with show(story.opening(), size=(100, 30)) as (app, pilot, _, _):
        await pilot.press("escape", "f1", "M")
        assert isinstance(app.screen, ManualScreen)
        await shown(pilot, app.screen)
        assert title(app.screen) == load_manual().pages[0].title
        await pilot.press("escape")
        assert isinstance(app.screen, HelpScreen)
        await pilot.press("escape")
        assert app.screen is app.session.main
        await pilot.press("M")
        assert isinstance(app.screen, ManualScreen)


async def test_the_page_at_the_pointer_is_shown(show: Show) -> None:
    async with show(story.opening(), size=(100, 30)) as (_, pilot, _, _):
        screen = await opened(pilot)
        assert (title(screen), marked(screen)) == ("Manual", [])
        await pilot.press("down", "down")
        await shown(pilot, screen)
        assert title(screen) == "Console"
        await press(pilot, "enter")
        assert screen.focused is screen.query_one("#manual-page")


async def test_words_are_found_in_all_pages_and_lead_to_their_section(show: Show) -> None:
    async with show(story.opening(), size=(100, 30)) as (_, pilot, _, _):
        screen = await opened(pilot, "slash", *"sign", "enter")
        assert title(screen) == "Rules"
        assert marked(screen) == ["Signing"]
        assert screen.focused is screen.query_one("#manual-list")
        screen.query_one(Input).value = "ALARM seen"
        await shown(pilot, screen)
        assert (title(screen), marked(screen)) == ("Console", ["Alarms"])
        screen.query_one(Input).value = "alarm moon"
        await shown(pilot, screen)
        assert screen.query_one(OptionList).option_count == 0
        screen.query_one(Input).value = ""
        await shown(pilot, screen)
        assert screen.query_one(OptionList).option_count == len(MANUAL.pages)
        assert title(screen) == "Console"


async def test_a_link_leads_to_its_section_or_says_that_there_is_none(show: Show) -> None:
    async with show(story.opening(), size=(100, 30)) as (app, pilot, _, _):
        screen = await opened(pilot)
        text = screen.query_one(Markdown)
        text.post_message(Markdown.LinkClicked(text, "nowhere.md"))
        await shown(pilot, screen)
        assert "the manual has no page 'nowhere.md'" in notices(app)[-1]
        text.post_message(Markdown.LinkClicked(text, "rules.md#signing"))
        await shown(pilot, screen)
        assert (title(screen), marked(screen)) == ("Rules", ["Signing"])


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("words", ["", "sign"], ids=["pages", "found"])
def test_looks(snap_compare: Compare, tmp_path: Path, size: str, words: str) -> None:
    app = console(ScriptedStation(story.opening()), tmp_path)

    async def run(pilot: Pilot[Any]) -> None:
        await settle(pilot)
        await opened(pilot, *(("slash", *words, "enter") if words else ()))

    assert snap_compare(app, terminal_size=SIZES[size], run_before=run)
