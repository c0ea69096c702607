"""The approval panel says what to know first, and is armed only once all of it was on screen."""

from typing import Any

import pytest
from textual import events
from textual._xterm_parser import XTermParser
from textual.widgets import Button, Input

from pa_console.schema.events import event as ev
from pa_console.schema.plan import Action, Plan
from pa_console.tui.approval.inputs import REASON
from pa_console.tui.approval.panel import ARM_DELAY_S, ApprovalPanel
from pa_console.tui.approval.plan_words import approval_rows, reading_rows
from pa_console.tui.widgets.row_views import TextRows
from tests.tui import story
from tests.tui.scripted import Show, press, settle

SMALL = (80, 24)
EVERYBODY = Plan(
    reason="asked: all free to EastGate; Free drone: Drone_T04",
    actions=tuple(
        Action(agent=name, command=command)
        for command in ("move_to EastGate", "report", "hold")
        for name in story.WORLD.assets
    ),
)
LEFT = ("all free to EastGate: Drone_T01 covers NorthGate alone (WF-03)",)


def as_a_terminal_sends(sequence: str) -> list[str]:
    """Return the keys that Textual makes of what a terminal sends."""
    return [event.key for event in XTermParser().feed(sequence) if isinstance(event, events.Key)]


def narrowed() -> list[ev.EventPayload]:
    """An order to all that is planned for many, one of them misspelt by its operator."""
    mission = story.MISSION.model_copy(
        update={"text": "Send all assets east.", "typed": "Send all asets east."}
    )
    told: list[ev.EventPayload] = []
    for data in story.told("approval", unmet=LEFT):
        match data:
            case ev.PlanProposed() | ev.ApprovalRequested():
                told.append(data.model_copy(update={"plan": EVERYBODY}))
            case ev.MissionReceived():
                told.append(data.model_copy(update={"mission": mission}))
            case _:
                told.append(data)
    return told


def said(panel: ApprovalPanel) -> str:
    return " ".join(panel.query_one("#approval-text", TextRows).render().plain.split())


@pytest.mark.parametrize(
    ("told", "title"),
    [
        (story.told("approval", confidence=0.8), "✔ Approve"),
        (story.told("approval", unmet=LEFT), "△ Narrowed by rules"),
        (story.told("approval", broken=("CAP-04",)), "△ Breaks a Medium rule"),
        (story.told("approval", confidence=0.18), "△ May be misunderstood"),
        (story.not_understood("Schick die Drohne zum Osttor."), "? Not understood"),
        (story.told("approval", verdict="Failure"), "✘ Judge objects"),
        (story.told("approval", blocked=("WF-03: a gate is left",)), "✘ Blocked"),
    ],
)
async def test_the_title_says_what_to_know_first(
    told: list[ev.EventPayload], title: str, show: Show
) -> None:
    async with show(told, size=SMALL) as (app, _, _, _):
        panel = app.screen.query_one(ApprovalPanel)
        assert panel.border_title == title
        assert ("✔ No rule is broken" in said(panel)) == (title == "✔ Approve")


@pytest.mark.parametrize(
    ("options", "words", "told"),
    [
        ({"confidence": 0.41}, "Confidence 41%: the order may mean", True),
        ({"confidence": 0.93}, "the order may mean", False),
        ({"confidence": None}, "the order may mean", False),
        ({"confidence": 0.41, "as_chosen": True, "readings": ("asked: all hold",)},
         "✎ read as you meant it: see to the unknown vehicle at NorthGate", True),
    ],
)  # fmt: skip
def test_the_panel_says_how_sure_the_reading_is(
    options: dict[str, Any], words: str, told: bool
) -> None:
    trace = story.folded(story.told("approval", **options)).current
    assert trace is not None
    rows = (*approval_rows(trace), *reading_rows(trace))
    said = " ".join((row.lead + row.body).plain for row in rows)
    assert (words in said) == told


async def test_a_narrowed_plan_is_armed_when_its_last_line_was_on_screen(show: Show) -> None:
    async with show(narrowed(), size=SMALL) as (app, pilot, station, clock):
        clock.now += ARM_DELAY_S
        panel = app.screen.query_one(ApprovalPanel)
        for _ in range(20):
            if not panel.query_one("#approve", Button).disabled:
                break
            await pilot.press("a", "enter")
            assert station.decisions == []
            clock.now += ARM_DELAY_S
            await press(pilot, "pagedown")
        body = panel.query_one("#approval-body")
        assert body.scroll_offset.y == body.max_scroll_y > 0
        clock.now += ARM_DELAY_S
        await press(pilot, "a", "enter")
        assert station.decided == ["approve"]


async def test_a_jump_to_the_end_has_not_shown_what_lies_between(show: Show) -> None:
    async with show(narrowed(), size=SMALL) as (app, pilot, _, _):
        panel = app.screen.query_one(ApprovalPanel)
        panel.query_one("#approval-body").scroll_end(animate=False)
        await settle(pilot)
        assert panel.query_one("#approve", Button).disabled


async def test_the_typed_words_stand_beside_their_reading(show: Show) -> None:
    async with show(narrowed(), size=SMALL) as (app, _, _, _):
        text = said(app.screen.query_one(ApprovalPanel))
        assert "typed Send all asets (read: assets) east." in text
        assert "read send every free asset to EastGate" in text
        told = "Not done: all free to EastGate, because Drone_T01 covers NorthGate alone (WF-03)"
        assert told in text


@pytest.mark.parametrize(("sure", "doubt"), [(0.9, "Another reader differs"), (0.4, "Unsure")])
async def test_a_reading_says_why_it_may_be_wrong(sure: float, doubt: str, show: Show) -> None:
    told = [
        data.model_copy(update={"read_apart": True, "state": "may_be_misunderstood"})
        if isinstance(data, ev.ApprovalRequested)
        else data
        for data in story.told("approval", confidence=sure, readings=("asked: all hold",))
    ]
    async with show(told, size=SMALL) as (app, _, _, _):
        panel = app.screen.query_one(ApprovalPanel)
        read = panel.query_one("#approval-reading", TextRows).render().plain
        assert f"△ {doubt}  read with {sure:.0%} confidence as: " in read


async def test_what_was_not_understood_can_only_be_rejected(show: Show) -> None:
    async with show(story.not_understood("asdf qwer"), size=SMALL) as (app, pilot, station, clock):
        clock.now += ARM_DELAY_S
        assert "What is to be done, in English?" in said(app.screen.query_one(ApprovalPanel))
        await press(pilot, "a", "enter", "m", "enter")
        assert station.decisions == []
        await press(pilot, "r", "enter")
        assert station.decided == ["reject"]


@pytest.mark.parametrize(
    ("keys", "answer"),
    [
        (["alt+2", "enter"], "WestGate"),
        ([*as_a_terminal_sends("\x1b2"), "enter"], "WestGate"),
        ([*"west", "enter"], "west"),
    ],
)
async def test_a_question_is_answered_by_a_key_or_in_words(
    keys: list[str], answer: str, show: Show
) -> None:
    async with show(story.asked_back(), size=SMALL) as (app, pilot, station, clock):
        panel = app.screen.query_one(ApprovalPanel)
        assert "Which one is meant?" in said(panel)
        clock.now += ARM_DELAY_S
        if keys[0] == "w":
            panel.query_one(f"#{REASON}", Input).focus()
        await press(pilot, *keys)
    assert [(one.kind, one.asked) for one in station.decisions] == [("answer", answer)]
