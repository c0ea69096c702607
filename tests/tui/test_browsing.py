"""Policies, help, palette, what-ifs, copies, keys of the user's own."""

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from textual.pilot import Pilot
from textual.widgets import Footer, Input, OptionList, Select

from pa_console.schema.incident import SpawnTrack
from pa_console.schema.rule import RuleExample
from pa_console.tui.actions import ACTIONS, ActionContext
from pa_console.tui.app import ConsoleApp
from pa_console.tui.screens.manual import help_rows
from pa_console.tui.screens.policies import PolicyScreen
from pa_console.tui.screens.rule_rows import rule_rows
from pa_console.tui.widgets.row_views import TextRows
from tests.tui import story
from tests.tui.scripted import Show, notices, press, settle, until
from tests.tui.site import RULES, WORLD


async def test_policies_are_searched_with_live_scores_and_filtered(show: Show) -> None:
    async with show(story.opening()) as (app, pilot, _, _):
        await press(pilot, "f6")
        screen = app.screen
        assert isinstance(screen, PolicyScreen)
        assert [rule.id for rule in screen.shown()] == [rule.id for rule in RULES]
        await press(pilot, *"each gate")
        assert screen.shown()[0].id == "WF-03"
        assert "blocks a plan for everyone" in str(screen.query_one(TextRows).render())
        screen.query_one("#policy-domain", Select).value = "WF"
        await settle(pilot)
        assert {rule.id for rule in screen.shown()} == {"WF-03", "WF-09"}
        screen.query_one("#policy-mode", Select).value = "judged"
        await settle(pilot)
        assert [rule.id for rule in screen.shown()] == ["WF-09"]
        assert screen.query_one(OptionList).option_count == 1
        assert "only the judge can assess it" in str(screen.query_one(TextRows).render())
        await press(pilot, "escape")
        assert app.screen is app.session.main


async def test_a_rule_shows_its_check_and_examples(show: Show) -> None:
    async with show(story.opening()) as (app, pilot, _, _):
        await press(pilot, "f6", "tab", "tab", "tab", "tab", "down")
        text = str(app.screen.query_one(TextRows).render())
        for words in ("ROE-02", "tracks.all", "must be broken: blocked unseen",
                      "Ugv_T01: block EastGate"):  # fmt: skip
            assert words in text


def test_help_lists_every_action_and_says_why_not() -> None:
    text = "\n".join(item.lead.plain + item.body.plain for item in help_rows(ActionContext()))
    assert all(action.help in text for action in ACTIONS)
    assert "(now: only in a replay)" in text


async def test_a_what_if_from_the_palette_reaches_the_simulation(show: Show) -> None:
    async with show(story.opening()) as (app, pilot, station, _):
        await pilot.press("f10")
        await pilot.pause()
        app.screen.query_one(Input).value = "unknown vehicle at EastGate"
        results = app.screen.query_one(OptionList)
        while not results.option_count or results.get_option_at_index(0).disabled:
            await pilot.pause()
        await pilot.press("down", "enter")
        while not station.injected:
            await pilot.pause()
        assert station.injected == [SpawnTrack(gate="EastGate")]
        assert WORLD.gates.count("EastGate") == 1


async def test_the_palette_offers_only_what_is_legal(show: Show) -> None:
    async with show(story.opening()) as (app, pilot, _, _):
        await pilot.press("f10")
        results = app.screen.query_one(OptionList)
        while results.option_count < 10:
            await pilot.pause()
        offered = " ".join(str(option.prompt) for option in results.options)
        assert "Browse and search the rules  (F6" in offered
        assert "Stop: every asset holds" in offered
        assert "Cancel the active mission" not in offered
        assert "Play or pause" not in offered


@pytest.mark.parametrize(
    ("words", "found"), [("export", "Copy the trace"), ("session", "Leave the console")]
)
async def test_the_palette_finds_an_action_by_what_it_is_also_called(
    words: str, found: str, show: Show
) -> None:
    async with show(story.told("finished")) as (app, pilot, _, _):
        await pilot.press("f10", *words)
        results = app.screen.query_one(OptionList)
        await until(pilot, lambda: found in " ".join(str(o.prompt) for o in results.options))


async def from_palette(pilot: Pilot[Any], app: ConsoleApp, words: str) -> None:
    """Choose the first entry that the palette finds for `words`."""
    await pilot.press("f10")
    await pilot.pause()
    app.screen.query_one(Input).value = words
    results = app.screen.query_one(OptionList)
    await until(pilot, lambda: results.option_count and not results.get_option_at_index(0).disabled)
    await pilot.press("down", "enter")


async def test_the_palette_takes_a_screenshot_without_itself(show: Show, tmp_path: Path) -> None:
    async with show(story.told("finished")) as (app, pilot, _, _):
        await from_palette(pilot, app, "screenshot")
        await until(pilot, lambda: list(tmp_path.rglob("screen-*.svg")))
    [picture] = tmp_path.rglob("screen-*.svg")
    text = "".join(ElementTree.parse(picture).getroot().itertext()).replace("\xa0", " ")
    assert "STOP ALL" in text
    assert "screenshot" not in text, "the palette is closed before"


async def test_the_palette_lists_every_theme_and_sets_one(show: Show) -> None:
    async with show(story.opening()) as (app, pilot, _, _):
        await from_palette(pilot, app, "theme nord")
        await until(pilot, lambda: app.theme == "nord")


async def test_the_help_of_a_screen_begins_with_its_own_keys(show: Show) -> None:
    async with show(story.opening()) as (app, pilot, _, _):
        await pilot.press("f6")
        await until(pilot, lambda: isinstance(app.screen, PolicyScreen))
        await press(pilot, "f1")
        lines = str(app.screen.query_one(TextRows).render()).splitlines()
        assert lines[0] == "On this screen"
        assert ["Del", "Remove"] in [line.split() for line in lines[:8]]


def test_an_example_of_a_rule_is_shown_as_its_file_has_it() -> None:
    given = {"tracks": {"V1": {"gate": "WestGate", "warned": True}}}
    example = RuleExample(name="warned", expect="pass", given=given)
    rule = RULES[0].model_copy(update={"examples": (example,)})
    text = "\n".join(item.lead.plain + item.body.plain for item in rule_rows(rule, None))
    assert "given {tracks: {V1: {gate: WestGate, warned: true}}}" in text


async def test_speed_goes_up_and_down_within_bounds(show: Show) -> None:
    async with show(story.opening()) as (_, pilot, station, _):
        await pilot.press("f2", *["plus"] * 5)
        assert station.rate == 8.0
        await pilot.press(*["minus"] * 5)
        assert station.rate == 1.0


async def test_copies_go_to_the_clipboard_and_to_a_file(tmp_path: Path, show: Show) -> None:
    async with show(story.told("finished")) as (app, pilot, _, _):
        await pilot.press("f4", "y")
        trace = (tmp_path / "copies" / "M-003-trace.txt").read_text()
        assert app.clipboard == trace
        assert "You plan for a checkpoint." in trace
        assert "Do not use lethal" in trace
        await pilot.press("Y")
        assert (tmp_path / "copies" / "M-003-plan.json").read_text() == app.clipboard
        assert '"Drone_T04"' in app.clipboard


async def test_a_folder_that_cannot_be_written_is_no_crash(tmp_path: Path, show: Show) -> None:
    (tmp_path / "copies").write_text("a file in the way")
    (tmp_path / "history.txt").mkdir()
    async with show(story.told("finished")) as (app, pilot, station, _):
        await press(pilot, *"go", "enter", "escape", "y")
        assert station.submitted == ["go"]
        assert "M-003" in app.clipboard


async def test_an_interrupt_does_not_leave_and_says_how_to(show: Show) -> None:
    async with show(story.opening()) as (app, pilot, _, _):
        for focused in ("escape", "i"):
            app.clear_notifications()
            await press(pilot, focused, "ctrl+c")
            assert app.is_running
            assert notices(app)[-1].startswith("q ^q leaves the console")


async def test_an_interrupt_with_a_selection_copies_it(show: Show) -> None:
    async with show(story.opening()) as (app, pilot, _, _):
        await press(pilot, *"scout", "shift+home", "ctrl+c")
        assert app.clipboard == "scout"
        assert notices(app) == []


async def test_the_footer_leaves_out_a_key_rather_than_cut_it(show: Show) -> None:
    async with show(story.told("approval"), size=(120, 24)) as (app, pilot, _, _):
        await press(pilot, "f7")
        footer = app.screen.query_one(Footer)
        wide = [key for key in footer.children if key.visible]
        assert wide == [*footer.children]
        ends = wide[-1].region.right
        await pilot.resize_terminal(ends - 1, 24)
        await settle(pilot)
        narrow = [key for key in footer.children if key.visible]
        assert narrow == wide[:-1]
        await pilot.resize_terminal(ends, 24)
        await settle(pilot)
        assert [key for key in footer.children if key.visible] == wide
