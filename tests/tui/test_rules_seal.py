"""Which rule set is in force is seen in the policy browser, and an altered one always."""

import pytest
from textual.widgets import Static

from pa_console.schema.events.event import EventPayload
from pa_console.schema.rule import RulesSeal
from pa_console.tui.screens.dialogs import Confirm
from pa_console.tui.screens.policies import PolicyScreen
from tests.tui import story
from tests.tui.scripted import Show, press
from tests.tui.test_mission import shown

ALTERED = RulesSeal(version="3", content_sha256="ab" * 32, standing="altered", problem="edited")


def opened_with(seal: RulesSeal) -> list[EventPayload]:
    """Return the beginning of a session under rules that stand so."""
    return [story.STARTED.model_copy(update={"rules_seal": seal}), *story.opening()[1:]]


async def test_the_policy_browser_names_version_hash_and_standing(show: Show) -> None:
    async with show(story.opening(), size=(80, 24)) as (app, pilot, _, _):
        await press(pilot, "f6")
        assert isinstance(app.screen, PolicyScreen)
        title = str(app.screen.query_one("#policy-title", Static).render())
        assert "site version 3 5ea15ea15ea1 not signed" in title


@pytest.mark.parametrize("size", [(60, 18), (120, 36)])
@pytest.mark.parametrize(
    ("seal", "words"),
    [
        (ALTERED, "RULES ALTERED"),
        (RulesSeal(accepted="not signed"), "RULES ACCEPTED, NOT VERIFIED"),
        (RulesSeal(no_critical_check=True), "RULES: NO CRITICAL CHECK"),
        (RulesSeal(), ""),
    ],
)
async def test_what_must_be_said_of_the_rules_is_in_the_status_bar(
    seal: RulesSeal, words: str, size: tuple[int, int], show: Show
) -> None:
    async with show(opened_with(seal), size=size) as (app, _, _, _):
        said = shown(app, "#status")
        assert words in said if words else "RULES" not in said


async def test_refused_rules_are_accepted_in_the_browser_only_after_a_question(show: Show) -> None:
    async with show(story.opening()) as (app, pilot, station, _):
        await press(pilot, "f6", "tab", "tab", "tab", "tab")
        app.screen.query_one("#policy-list").focus()
        await press(pilot, "a")
        assert not isinstance(app.screen, Confirm)
        station.offered = "not signed, and the set used before is signed"
        for key, accepted in (("enter", 0), ("a", 0), ("y", 1)):
            if key == "enter":
                await press(pilot, "a")
                assert isinstance(app.screen, Confirm)
            await press(pilot, key)
            assert station.accepted == accepted
