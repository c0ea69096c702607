"""Modify is a form: one row an action, with names to pick, checked while one edits."""

from typing import Any

import pytest
from textual.pilot import Pilot
from textual.widgets import Button, Static

from pa_console.schema.finding import Finding
from pa_console.tui.app import ConsoleApp
from pa_console.tui.approval.panel import ARM_DELAY_S
from pa_console.tui.screens.plan_editing import ActionRow, PlanForm, nearest
from tests.tui import story
from tests.tui.scripted import FakeClock, Show, press, settle, until

pytestmark = pytest.mark.long

ASSETS = tuple(story.WORLD.assets)


async def open_form(app: ConsoleApp, pilot: Pilot[Any], clock: FakeClock) -> list[ActionRow]:
    """Choose Modify and return the rows of the form."""
    clock.now += ARM_DELAY_S
    await pilot.press("m", "enter")
    await until(pilot, lambda: app.screen.query("#plan-form"))
    return rows(app)


def rows(app: ConsoleApp) -> list[ActionRow]:
    return list(app.screen.query(ActionRow))


def said(app: ConsoleApp) -> str:
    """Return all that the checks say."""
    parts = (app.screen.query(".-said, #plan-verdict")).results(Static)
    return " ".join(str(part.render()) for part in parts)


@pytest.mark.parametrize(
    ("typed", "name"), [("Drone_T4", "Drone_T04"), ("drone04", "Drone_T04"), ("ugv1", "Ugv_T01")]
)
def test_a_name_is_found_from_what_is_like_it(typed: str, name: str) -> None:
    assert nearest(typed, ASSETS) == name


@pytest.mark.parametrize("size", [(80, 24), (120, 36)])
async def test_an_asset_that_does_not_exist_is_told_at_once_with_the_one_that_is_meant(
    show: Show, size: tuple[int, int]
) -> None:
    async with show(story.told("approval"), size=size) as (app, pilot, _, clock):
        first, *_ = await open_form(app, pilot, clock)
        first.agent.value = "Drone_T4"
        await settle(pilot)
        assert "did you mean Drone_T04?" in said(app)
        assert app.screen.query_one("#send", Button).disabled
        await pilot.press("down")
        assert first.agent.value == "Drone_T04"
        await settle(pilot)
        assert not app.screen.query_one("#send", Button).disabled


async def test_a_command_that_the_asset_cannot_do_and_an_unknown_place_are_told(show: Show) -> None:
    async with show(story.told("approval")) as (app, pilot, _, clock):
        first, *_ = await open_form(app, pilot, clock)
        first.agent.value, first.verb.value, first.place.value = "Drone_T04", "block", "EastGate"
        await settle(pilot)
        assert "a UAV cannot block" in said(app)
        first.verb.value, first.place.value = "observe", "EstGate"
        await settle(pilot)
        assert "did you mean EastGate?" in said(app)


async def test_rows_are_added_and_removed_and_the_plan_is_sent(show: Show) -> None:
    async with show(story.told("approval")) as (app, pilot, station, clock):
        before = len(await open_form(app, pilot, clock))
        await pilot.press("ctrl+n", *"ugv1", "enter", *"hold", "enter")
        assert len(rows(app)) == before + 1
        await settle(pilot)
        rows(app)[0].agent.focus()
        await press(pilot, "ctrl+d")
        assert len(rows(app)) == before
        await press(pilot, "ctrl+s")
        [decision] = station.decisions
        assert decision.plan is not None
        assert decision.plan.actions[-1].agent == "Ugv_T01"
        assert decision.plan.actions[-1].command == "hold"


async def test_a_broken_rule_stands_at_the_row_of_its_asset(show: Show) -> None:
    async with show(story.told("approval")) as (app, pilot, station, clock):
        agent = story.PLAN.actions[0].agent
        station.findings = (
            Finding(
                rule_id="CAP-04", priority="medium", status="violates", message=f"low: {agent}"
            ),
        )
        first, *_ = await open_form(app, pilot, clock)
        await until(pilot, lambda: "CAP-04" in said(app))
        assert f"△ CAP-04: low: {agent}" in str(first.query_one(".-said", Static).render())


async def test_a_left_draft_is_there_again_also_as_json_and_back(show: Show) -> None:
    async with show(story.told("approval")) as (app, pilot, station, clock):
        first, *_ = await open_form(app, pilot, clock)
        first.place.value = "SouthGate"
        await pilot.press("f4")
        await until(pilot, lambda: app.screen.query("#editor"))
        assert "SouthGate" in app.screen.query_one("#editor-text").text  # pyright: ignore
        await pilot.press("f4")
        await until(pilot, lambda: isinstance(app.screen, PlanForm))
        assert rows(app)[0].place.value == "SouthGate"
        await press(pilot, "escape")
        await until(pilot, lambda: not app.screen.query("Button.-active"))
        await pilot.press("m", "enter")
        await until(pilot, lambda: isinstance(app.screen, PlanForm))
        assert rows(app)[0].place.value == "SouthGate"
        assert station.decisions == []
