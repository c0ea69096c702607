"""A console that has joined another station's session says whose it is, and can only sign."""

import pytest
from textual.widgets import Button, Static

from pa_console.language.questions import Question
from pa_console.schema.events import event as ev
from pa_console.schema.events.event import AnswerLine
from pa_console.schema.mission import Decision
from pa_console.tui.approval.panel import ARM_DELAY_S, ApprovalPanel
from pa_console.tui.screens.dialogs import Confirm
from pa_console.tui.surroundings import JoinedTo
from pa_console.tui.widgets.bars import StatusBar
from pa_console.tui.widgets.mission_prompt import MissionInput
from pa_console.tui.widgets.row_views import TextRows
from tests.tui import story
from tests.tui.scripted import FakeClock, ScriptedStation, Show, notices, press, settle, until
from tests.tui.test_typing import Typist

BOB = JoinedTo("north", "bob")


def waiting(people: int) -> list[ev.EventPayload]:
    """A session with a plan that waits for so many people."""
    asked = {"observe": people} if people > 1 else {}
    return [
        each.model_copy(update={"approvals": asked})
        if isinstance(each, ev.ApprovalRequested)
        else each
        for each in story.told("approval")
    ]


async def test_it_names_the_session_and_signs_what_takes_two_people(show: Show) -> None:
    async with show(waiting(2), joined=BOB) as (app, pilot, station, clock):
        assert "JOINED north" in str(app.screen.query_one(StatusBar).render())
        assert "TO SIGN" in str(app.screen.query_one(StatusBar).render())
        panel = app.screen.query_one(ApprovalPanel)
        shown = [button.id for button in panel.query(Button) if button.display]
        assert shown == ["approve"]
        assert app.focused is panel, "Enter signs nothing by itself"
        clock.now += ARM_DELAY_S
        await press(pilot, "enter", "r", "enter", "m", "enter")
        assert station.decisions == []
        await press(pilot, "a", "enter")
        assert station.decided == ["approve"]
        await press(pilot, "f9", "f8")
        assert (station.stopped, station.cancelled) == (1, 0)


@pytest.mark.parametrize(("joined", "people"), [(BOB, 1), (JoinedTo("north", ""), 2)])
async def test_nothing_is_signed_that_takes_one_person_or_by_an_observer(
    joined: JoinedTo, people: int, show: Show
) -> None:
    async with show(waiting(people), joined=joined) as (app, pilot, station, clock):
        clock.now += ARM_DELAY_S
        await press(pilot, "a", "enter", "f7", "a", "enter")
        assert station.decisions == []
        assert app.screen.query_one("#approve", Button).disabled or not joined.signer


async def test_a_question_is_answered_here_and_an_order_is_refused(show: Show) -> None:
    station, clock = ScriptedStation(waiting(1)), FakeClock()
    question = Question("Why not Ugv_T02?", "other_asset", ("Ugv_T02",))
    others = Question("What else?", "alternatives")
    line = AnswerLine(about="Ugv_T02", said="it alone covers EastGate")
    station.questions = {each.text: each for each in (question, others)}
    station.answers = {each.text: (line,) for each in (question, others)}
    async with show(station, clock=clock, joined=BOB) as (app, pilot, station, _):
        field = app.screen.query_one(MissionInput)
        assert "north commands this session" in str(field.placeholder)
        clock.now += ARM_DELAY_S
        for asked in station.questions:
            await pilot.press("slash", *asked, "enter")
            await until(pilot, lambda: bool(app.screen.query("#answer-rows")))
            rows = app.screen.query_one("#answer-rows", TextRows)
            await until(pilot, lambda rows=rows: "it alone covers" in rows.render().plain)
            await press(pilot, "escape")
            assert field.text == ""
        station.refuse = "this is the session of north, which is in command"
        await press(pilot, "slash", *"Send a drone home", "enter")
        assert station.refuse in notices(app)
        assert field.text == "Send a drone home"
        assert (station.submitted, station.decisions) == ([], [])


async def test_a_question_that_is_typed_at_the_plan_signs_nothing(show: Show) -> None:
    async with show(waiting(2), keys_by_clock=True, joined=BOB) as (_, pilot, station, clock):
        clock.now += ARM_DELAY_S
        for asked in ("why that\n", "What else\n", "a drone instead\n"):
            await Typist(pilot, clock).types(asked)
            await pilot.press("escape", "escape")
            clock.now += ARM_DELAY_S
        await settle(pilot)
        assert (station.decisions, station.stopped) == ([], 0)


async def test_both_screens_say_who_has_signed(show: Show) -> None:
    async with show(waiting(2)) as (app, pilot, station, clock):
        signed = Decision(kind="approve", by="bob at another station", signatures={"bob": "s"})
        detail = "observe needs 2 people to approve, so far there is 1"
        station.emit(ev.DecisionMade(attempt=1, decision=signed, accepted=False, detail=detail))
        await settle(pilot)
        rows = app.screen.query_one("#approval-text", TextRows)
        told = "\n".join(strip.text for strip in map(rows.render_line, range(rows.size.height)))
        assert "Signed  bob at another station" in told
        assert "so far" in told
        assert "not accepted" not in told
        clock.now += ARM_DELAY_S
        await press(pilot, "a", "enter")
        assert len(station.decisions) == 1


@pytest.mark.parametrize(("answer", "takes"), [("y", True), ("enter", False)])
async def test_a_commander_takes_command_after_a_question_that_says_what_it_does(
    answer: str, takes: bool, show: Show
) -> None:
    joined = JoinedTo("north", "bob", lambda: "Put south in command in place of north?")
    async with show(story.opening(), joined=joined) as (app, pilot, _, _):
        await press(pilot, "ctrl+k")
        question = app.screen.query_one("#confirm Static", Static)
        assert "in place of north?" in str(question.render())
        await pilot.press(answer)
        await until(pilot, lambda: not isinstance(app.screen, Confirm) or not app.is_running)
    assert app.controllers.leaving.takes_command == takes


async def test_nobody_else_is_offered_command_and_what_hinders_it_is_said(show: Show) -> None:
    def hindered() -> str:
        raise ValueError("this station is not in the roster")

    for joined in (BOB, JoinedTo("north", "bob", hindered)):
        async with show(story.opening(), joined=joined) as (app, pilot, _, _):
            await press(pilot, "ctrl+k")
            assert not app.screen.query("#confirm")
            assert ("this station is not in the roster" in notices(app)) == (joined is not BOB)
            assert not app.controllers.leaving.takes_command


async def test_a_relieved_station_says_so_at_the_top(show: Show) -> None:
    async with show(waiting(1)) as (app, pilot, station, _):
        bar = app.screen.query_one(StatusBar)
        station.emit(ev.AuthorityChanged(refusal="south is in command since epoch 2"))
        await settle(pilot)
        assert "NOT IN COMMAND: NOTHING IS SENT" in str(bar.render())
        station.emit(ev.AuthorityChanged(refusal=""))
        await settle(pilot)
        assert "NOT IN COMMAND" not in str(bar.render())
