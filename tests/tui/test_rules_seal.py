"""Which rule set is in force is seen in the policy browser, and an altered one always."""

from pathlib import Path

import pytest
from textual.widgets import Static

from pa_console.schema.events.event import EventPayload
from pa_console.schema.rule import RulesSeal
from pa_console.tui.screens.policies import PolicyScreen
from pa_console.tui.screens.questions import Confirm
from tests.tui import story
from tests.tui.scripted import ScriptedStation, console, settle
from tests.tui.test_mission import shown

ALTERED = RulesSeal(version="3", content_sha256="ab" * 32, standing="altered", problem="edited")


def opened_with(seal: RulesSeal) -> list[EventPayload]:
    """Return the beginning of a session under rules that stand so."""
    return [story.STARTED.model_copy(update={"rules_seal": seal}), *story.opening()[1:]]


async def test_the_policy_browser_names_version_hash_and_standing(tmp_path: Path) -> None:
    station = ScriptedStation(story.opening())
    app = console(station, tmp_path)
    async with app.run_test(size=(80, 24)) as pilot:
        await settle(pilot, station)
        await pilot.press("f6")
        await settle(pilot)
        assert isinstance(app.screen, PolicyScreen)
        title = str(app.screen.query_one("#policy-title", Static).render())
        assert "site version 3 5ea15ea15ea1 not signed" in title


async def test_altered_rules_are_said_in_the_status_bar_at_every_size(tmp_path: Path) -> None:
    for size in ((60, 18), (120, 36)):
        station = ScriptedStation(opened_with(ALTERED))
        app = console(station, tmp_path)
        async with app.run_test(size=size) as pilot:
            await settle(pilot, station)
            assert "RULES ALTERED" in shown(app, "#status")


async def test_rules_that_are_not_signed_are_not_shouted_about(tmp_path: Path) -> None:
    station = ScriptedStation(opened_with(RulesSeal()))
    app = console(station, tmp_path)
    async with app.run_test(size=(120, 36)) as pilot:
        await settle(pilot, station)
        assert "RULES" not in shown(app, "#status")


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"accepted": "not signed"}, "RULES ACCEPTED, NOT VOUCHED FOR"),
        ({"no_critical_check": True}, "RULES: NO CRITICAL CHECK"),
    ],
)
async def test_what_must_be_said_of_the_rules_is_in_the_status_bar_and_the_browser(
    tmp_path: Path, fields: dict[str, object], words: str
) -> None:
    seal = ALTERED.model_copy(update={"standing": "not signed", "problem": ""} | fields)
    station = ScriptedStation(opened_with(seal))
    app = console(station, tmp_path)
    async with app.run_test(size=(120, 36)) as pilot:
        await settle(pilot, station)
        assert words in shown(app, "#status")


async def test_refused_rules_are_accepted_in_the_browser_only_after_a_question(
    tmp_path: Path,
) -> None:
    station = ScriptedStation(story.opening())
    app = console(station, tmp_path)
    async with app.run_test(size=(120, 36)) as pilot:
        await settle(pilot, station)
        await pilot.press("f6", "tab", "tab", "tab", "tab")
        await settle(pilot)
        app.screen.query_one("#policy-list").focus()
        await pilot.press("a")
        await settle(pilot)
        assert not isinstance(app.screen, Confirm)
        station.offered = "not signed, and the set used before is signed"
        for key, accepted in (("enter", 0), ("a", 0), ("y", 1)):
            if key == "enter":
                await pilot.press("a")
                await settle(pilot)
                assert isinstance(app.screen, Confirm)
            await pilot.press(key)
            await settle(pilot)
            assert station.accepted == accepted
