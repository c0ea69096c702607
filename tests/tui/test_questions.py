"""A question at the prompt is answered in a panel; the plan that waits goes on waiting."""

import pytest
from textual.widgets import Static

from pa_console.language.questions import Question
from pa_console.schema.events.event import AnswerLine
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import RehearsedReading
from pa_console.station.answers.alternatives import Alternative
from pa_console.tui.app import ConsoleApp
from pa_console.tui.approval.comparison import PlanComparison
from pa_console.tui.approval.panel import ARM_DELAY_S, ApprovalPanel
from pa_console.tui.screens.answer import LOOKING, AnswerScreen
from pa_console.tui.widgets.mission_prompt import MissionInput
from pa_console.tui.widgets.row_views import TextRows
from tests.tui import story
from tests.tui.scripted import FakeClock, ScriptedStation, Show, press, settle, until
from tests.tui.test_mission import shown

pytestmark = pytest.mark.long

WHY = Question("Why not Ugv_T02?", "other_asset", ("Ugv_T02",))
INSTEAD = Question("What else?", "alternatives")
LINES = (
    AnswerLine(about="Ugv_T02", said="it alone covers EastGate"),
    AnswerLine(about="Ugv_T02", said="WF-03: EastGate left uncovered"),
)
WAY = Plan(reason=story.ASKED, actions=(Action(agent="Ugv_T02", command="move_to NorthGate"),))


def asked(state: str) -> ScriptedStation:
    station = ScriptedStation(story.told(state))
    station.questions = {WHY.text: WHY, INSTEAD.text: INSTEAD}
    station.answers = {WHY.text: LINES, INSTEAD.text: LINES[:1]}
    found = RehearsedReading(plan=WAY, rehearsal=story.rehearsal())
    station.alternatives = [Alternative("way", story.ASKED, found)]
    return station


def said(app: ConsoleApp) -> str:
    return " ".join(app.screen.query_one("#answer-rows", TextRows).render().plain.split())


@pytest.mark.parametrize("slow", [False, True])
async def test_a_question_is_answered_over_a_plan_that_still_waits(
    show: Show, *, slow: bool
) -> None:
    station, clock = asked("approval"), FakeClock()
    if slow:
        station.slow.clear()
    async with show(station, clock=clock) as (app, pilot, station, _):
        await pilot.press("escape", "slash", *WHY.text, "enter")
        await until(pilot, lambda: isinstance(app.screen, AnswerScreen))
        if slow:
            await settle(pilot)
            assert said(app) == LOOKING
            station.slow.set()
        await until(pilot, lambda: "it alone covers EastGate" in said(app))
        clock.now += ARM_DELAY_S
        await pilot.press("a", "r", "m")
        await press(pilot, "escape")
        assert app.session.main is not None
        assert app.screen is app.session.main
        assert app.screen.query_one(ApprovalPanel).display
        assert app.screen.query_one(MissionInput).text == ""
        assert "You asked: Why not Ugv_T02?" in shown(app)
        assert "EastGate left uncovered" in shown(app)
        assert not station.submitted
        assert not station.decisions


async def test_an_order_beside_a_question_is_an_order(show: Show) -> None:
    async with show(asked("approval")) as (app, pilot, station, _):
        await press(pilot, "escape", "slash", *"Send it instead", "enter")
        assert station.submitted == ["Send it instead"]
        assert app.screen is app.session.main


async def test_what_else_stands_beside_the_plan_that_waits(show: Show) -> None:
    async with show(asked("approval")) as (app, pilot, station, _):
        await pilot.press("escape", "slash", *INSTEAD.text, "enter")
        await until(pilot, lambda: isinstance(app.screen, PlanComparison))
        screen = app.screen
        assert isinstance(screen, PlanComparison)
        await until(pilot, lambda: len(screen.columns) == 2)
        await press(pilot, "alt+1", "enter")
        assert [(each.kind, each.plan) for each in station.decisions] == [("modify", WAY)]
        assert not station.submitted


async def test_where_nothing_waits_an_order_for_what_is_chosen_is_only_typed(show: Show) -> None:
    async with show(asked("finished")) as (app, pilot, station, _):
        await pilot.press("escape", "slash", *INSTEAD.text, "enter")
        await until(pilot, lambda: isinstance(app.screen, PlanComparison))
        screen = app.screen
        assert isinstance(screen, PlanComparison)
        await until(pilot, lambda: len(screen.columns) == 2)
        await settle(pilot)
        assert "types an order" in str(screen.query_one("#comparison-note", Static).render())
        await press(pilot, "alt+1", "enter")
        assert app.screen is app.session.main
        assert app.screen.query_one(MissionInput).text == "Ugv_T02 to NorthGate."
        assert not station.submitted
        assert not station.decisions


async def test_the_stop_works_while_an_answer_is_read(show: Show) -> None:
    async with show(asked("executing")) as (app, pilot, station, _):
        await pilot.press("escape", "slash", *WHY.text, "enter")
        await until(pilot, lambda: isinstance(app.screen, AnswerScreen))
        await press(pilot, "f9")
        assert station.stopped == 1
