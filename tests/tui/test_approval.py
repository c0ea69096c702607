"""Deciding on a plan: nothing is approved by a stray key, and nothing inadmissible at all."""

from typing import Any

import pytest
from textual import events
from textual.pilot import Pilot
from textual.widget import Widget
from textual.widgets import Button, Input, TextArea

from pa_console.schema.events import event as ev
from pa_console.schema.mission import Decision, Metrics
from pa_console.schema.plan import Action, Plan
from pa_console.tui.app import ConsoleApp
from pa_console.tui.approval.panel import ARM_DELAY_S, ApprovalPanel
from pa_console.tui.theme import LEAST, contrast
from pa_console.tui.widgets.fields import CheckBox
from pa_console.tui.widgets.mission_prompt import MissionInput
from pa_console.tui.widgets.row_views import TextRows
from pa_console.tui.widgets.trace_pane import sections
from tests.tui import story
from tests.tui.scripted import FakeClock, ScriptedStation, Show, notices, press, settle, until
from tests.tui.site import picture

pytestmark = pytest.mark.long

SIZE = (120, 36)
OWN = Plan(reason="none of it", actions=(Action(agent="Drone_T04", command="hold"),))
BLOCKED = "WF-03: a gate is left without cover"


async def open_editor(app: ConsoleApp, pilot: Pilot[Any]) -> None:
    """Choose Modify, and JSON in its form."""
    await pilot.press("m", "enter")
    await until(pilot, lambda: app.screen.query("#plan-form"))
    await pilot.press("f4")
    await until(pilot, lambda: app.screen.query("#editor"))


async def test_keys_typed_ahead_are_dropped_and_then_approve_works(show: Show) -> None:
    async with show(story.told("approval")) as (app, pilot, station, clock):
        await press(pilot, "a", "enter", "r", "space")
        assert station.decisions == []
        clock.now += ARM_DELAY_S
        await press(pilot, "a", "enter")
        assert station.decided == ["approve"]
        assert not app.screen.query_one(ApprovalPanel).display


@pytest.mark.parametrize(("key", "field"), [("i", "#mission-input"), ("f", "#asset-filter")])
async def test_a_burst_of_typing_goes_into_the_field_that_its_first_key_opens(
    key: str, field: str, show: Show
) -> None:
    async with show(story.told("approval"), keys_by_clock=True) as (app, pilot, station, clock):
        await pilot.press("escape")
        clock.now += ARM_DELAY_S
        for letter in f"{key}a Scream":
            app.post_message(events.Key("space" if letter == " " else letter, letter))
        await settle(pilot)
        assert written(app.screen.query_one(field)) == "a Scream"
        assert station.decisions == []
        assert station.stopped == 0
        await pilot.press(key)
        assert written(app.screen.query_one(field)) == f"a Scream{key}"


def written(field: Widget) -> str:
    """What stands in a field."""
    assert isinstance(field, Input | TextArea)
    return field.value if isinstance(field, Input) else field.text


async def test_every_early_key_starts_the_delay_anew(show: Show) -> None:
    async with show(story.told("approval")) as (_, pilot, station, clock):
        clock.now += ARM_DELAY_S - 0.1
        await pilot.press("a")
        clock.now += ARM_DELAY_S - 0.1
        await pilot.press("a")
        assert station.decisions == []


async def test_a_click_before_the_delay_does_nothing(show: Show) -> None:
    async with show(story.told("approval")) as (_, pilot, station, _):
        await pilot.click("#approve")
        assert station.decisions == []


READINGS = (
    "asked: 2 drones to EastGate",
    "asked: if track at WestGate: hold, else: report; now: At WestGate: no track, not so",
)


async def test_another_reading_is_gone_to_with_alt_and_its_number_and_chosen_with_enter(
    show: Show,
) -> None:
    told = story.told("approval", confidence=0.41, readings=READINGS)
    async with show(told) as (app, pilot, station, clock):
        buttons = list(app.screen.query("#approval-readings Button").results(Button))
        labels = [str(button.label) for button in buttons]
        assert labels == [
            "(Alt+1) or: send 2 drones to EastGate",
            "(Alt+2) or: if something is at WestGate, stay put, otherwise report",
        ]
        said = " ".join(app.screen.query_one("#approval-reading", TextRows).render().plain.split())
        assert "read with 41% confidence as: see to the unknown vehicle at NorthGate" in said
        await pilot.press("alt+2")
        assert station.decisions == []
        clock.now += ARM_DELAY_S
        await pilot.press("alt+3", "2", "f7")
        assert station.decisions == []
        await pilot.press("alt+2")
        panel = app.screen.query_one(ApprovalPanel)
        assert panel.border_subtitle == "Enter takes this reading, Esc goes back to the plan"
        chosen = buttons[1]
        assert contrast(chosen.styles.color, chosen.background_colors[1]) >= LEAST
        await press(pilot, "enter")
        assert [(d.kind, d.asked) for d in station.decisions] == [("choose", READINGS[1])]


async def test_a_reading_can_be_chosen_where_the_plan_is_blocked(show: Show) -> None:
    told = story.told("approval", confidence=0.2, readings=READINGS[:1], blocked=(BLOCKED,))
    async with show(told) as (_, pilot, station, clock):
        clock.now += ARM_DELAY_S
        await pilot.click("#approval-readings Button")
        await settle(pilot)
        assert [d.asked for d in station.decisions] == [READINGS[0]]


@pytest.mark.parametrize("size", [(80, 24), (100, 30), SIZE, (160, 50)])
async def test_whatever_there_is_to_read_the_buttons_are_in_sight(
    size: tuple[int, int], show: Show
) -> None:
    long = READINGS[1].replace("hold", "Robot_T01, Robot_T02 identify vehicle at NorthGate")
    told = story.told(
        "approval",
        confidence=0.41,
        readings=(*READINGS, long),
        broken=("CAP-04",),
        verdict="Failure",
        unmet=("1 drone to WestGate: nobody can be spared",),
    )
    async with show(told, size=size) as (app, _, _, _):
        panel = app.screen.query_one(ApprovalPanel).content_region
        for widget in app.screen.query("#approval-buttons Button, #approval-reason"):
            assert panel.contains_region(widget.region)


@pytest.mark.parametrize(
    ("verdict", "keys", "decided"),
    [
        ("Success", ("enter",), [("reject", "")]),
        ("Success", ("a", "enter", "enter", "r", "enter"), [("approve", "")]),
        ("Success", ("2",), []),
        ("Failure", ("f7", "tab", "tab", *"seen", "enter", "a", "enter"), [("approve", "seen")]),
        ("Failure", ("f7", "shift+tab", *"seen", "enter", "a", "enter"), [("approve", "seen")]),
    ],
    ids=["a stray Enter", "once", "the key of a view", "Tab to the reason", "Tab back to it"],
)
async def test_keys_decide_what_they_say(
    verdict: str, keys: tuple[str, ...], decided: list[tuple[str, str]], show: Show
) -> None:
    async with show(story.told("approval", verdict=verdict)) as (app, pilot, station, clock):
        assert app.screen.query_one("#reject", Button).has_focus
        clock.now += ARM_DELAY_S
        await press(pilot, *keys)
        assert [(each.kind, each.reason) for each in station.decisions] == decided


async def test_who_is_typing_keeps_the_keys(show: Show) -> None:
    async with show(story.told("planning")) as (app, pilot, station, clock):
        await pilot.press(*"arm")
        station.emit(*story.judged())
        await settle(pilot)
        clock.now += 10
        await pilot.press("a", "r")
        assert station.decisions == []
        assert app.screen.query_one(MissionInput).text == "armar"
        await press(pilot, "f7", "r", "enter")
        assert station.decided == ["reject"]


async def test_a_blocked_plan_cannot_be_approved(show: Show) -> None:
    async with show(story.told("approval", broken=("WF-03",), blocked=(BLOCKED,))) as (
        app,
        pilot,
        station,
        clock,
    ):
        clock.now += ARM_DELAY_S
        panel = app.screen.query_one(ApprovalPanel)
        assert app.screen.query_one("#approve", Button).disabled
        assert "nobody may override" in str(panel.border_subtitle)
        await pilot.press("a", "enter")
        await pilot.click("#approve")
        assert station.decisions == []


async def test_a_plan_that_waits_is_blocked_while_its_station_is_not_in_command(show: Show) -> None:
    async with show(story.told("approval", confidence=0.9)) as (app, pilot, station, clock):
        panel = app.screen.query_one(ApprovalPanel)
        assert str(panel.border_title) == "✔ Approve"
        station.emit(ev.AuthorityChanged(refusal="south is in command since epoch 2"))
        await settle(pilot)
        clock.now += ARM_DELAY_S
        assert "Blocked" in str(panel.border_title)
        await pilot.press("a", "enter")
        await pilot.click("#approve")
        assert station.decisions == []
        station.emit(ev.AuthorityChanged(refusal=""))
        await settle(pilot)
        clock.now += ARM_DELAY_S
        assert str(panel.border_title) == "✔ Approve"
        await press(pilot, "a", "enter")
        assert station.decided == ["approve"]


async def test_a_judges_failure_needs_a_reason(show: Show) -> None:
    async with show(story.told("approval", verdict="Failure")) as (app, pilot, station, clock):
        clock.now += ARM_DELAY_S
        await pilot.press("a", "enter")
        assert station.decisions == []
        assert app.screen.query_one("#approval-reason", Input).has_focus is False
        await pilot.press("a", *"seen", "enter", "enter")
        assert station.decisions == []
        await press(pilot, "a", "enter")
        (decision,) = station.decisions
        assert decision.override_judge
        assert decision.reason == "seen"


async def test_warnings_must_be_ticked(show: Show) -> None:
    async with show(story.told("approval", broken=("CAP-04",))) as (app, pilot, station, clock):
        clock.now += ARM_DELAY_S
        await pilot.press("a")
        assert app.screen.query_one(CheckBox).has_focus
        panel = app.screen.query_one(ApprovalPanel)
        await pilot.press("space", "a")
        assert panel.border_title == "△ Breaks a Medium rule"
        await pilot.press("enter")
        assert panel.border_title == "△ Breaks a Medium rule", "it is no other plan once decided"
        await settle(pilot)
        assert station.decisions[0].acknowledged == ("CAP-04",)


async def test_reject_carries_the_reason(show: Show) -> None:
    async with show(story.told("approval")) as (app, pilot, station, clock):
        clock.now += ARM_DELAY_S
        app.screen.query_one("#approval-reason", Input).focus()
        await press(pilot, *"no", "enter", "r", "enter")
        assert (station.decisions[0].kind, station.decisions[0].reason) == ("reject", "no")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "JSON"),
        ('{"reason": "r", "actions": [{"agent": "D", "command": "fire"}]}', "unknown command"),
        ('{"reason": "r", "actions": [], "extra": 1}', "extra"),
    ],
)
async def test_modify_says_what_is_wrong_with_the_text(text: str, words: str, show: Show) -> None:
    async with show(story.told("approval")) as (app, pilot, station, clock):
        clock.now += ARM_DELAY_S
        await open_editor(app, pilot)
        app.screen.query_one(TextArea).text = text
        await pilot.pause()
        assert words in str(app.screen.query_one("#editor-error").render())
        await pilot.press("ctrl+s")
        await pilot.pause()
        assert station.decisions == []
        assert app.screen.query("#editor")


async def test_modify_sends_the_changed_plan_and_keeps_a_left_draft(show: Show) -> None:
    async with show(story.told("approval")) as (app, pilot, station, clock):
        clock.now += ARM_DELAY_S
        await open_editor(app, pilot)
        changed = app.screen.query_one(TextArea).text.replace("observe", "move_to")
        app.screen.query_one(TextArea).text = changed
        await press(pilot, "escape")
        await until(pilot, lambda: not app.screen.query("Button.-active"))
        await open_editor(app, pilot)
        assert app.screen.query_one(TextArea).text == changed
        await press(pilot, "ctrl+s")
        (decision,) = station.decisions
        assert decision.kind == "modify"
        assert decision.plan is not None
        assert decision.plan.actions[0].command == "move_to NorthGate"


async def test_a_whole_plan_is_replaced_from_the_keyboard_and_the_proposed_one_comes_back(
    show: Show,
) -> None:
    async with show(story.told("approval")) as (app, pilot, station, clock):
        clock.now += ARM_DELAY_S
        await open_editor(app, pilot)
        area = app.screen.query_one(TextArea)
        proposed, own = area.text, '{"reason": "none", "actions": []}'
        await pilot.press("ctrl+a", *own)
        assert area.text == own
        await pilot.press("ctrl+r")
        assert area.text == proposed
        await press(pilot, "ctrl+z", "ctrl+s")
        (decision,) = station.decisions
        assert decision.plan is not None
        assert (decision.plan.reason, decision.plan.actions) == ("none", ())


async def test_a_plan_that_was_not_changed_is_not_sent(show: Show) -> None:
    async with show(story.told("approval")) as (app, pilot, station, clock):
        clock.now += ARM_DELAY_S
        await open_editor(app, pilot)
        await press(pilot, "space", "ctrl+s")
        assert station.decisions == []
        assert notices(app)[-1] == "the plan is unchanged and still waits"
        await press(pilot, "a", "enter")
        assert station.decided == ["approve"]


async def test_the_proposed_plan_comes_back_after_the_operators_own_was_examined(
    show: Show,
) -> None:
    station, clock = ScriptedStation(story.told("approval")), FakeClock()
    station.emit(
        ev.DecisionMade(attempt=1, decision=Decision(kind="modify", plan=OWN), accepted=True),
        ev.PlanProposed(attempt=2, text=OWN.model_dump_json(), plan=OWN, author="operator"),
        ev.ApprovalRequested(attempt=2, plan=OWN),
    )
    async with show(station, clock=clock) as (app, pilot, station, _):
        clock.now += ARM_DELAY_S
        await open_editor(app, pilot)
        area = app.screen.query_one(TextArea)
        assert "none of it" in area.text
        await pilot.press("ctrl+r")
        assert story.PLAN.reason in area.text
        await press(pilot, "ctrl+s")
        (decision,) = station.decisions
        assert (decision.kind, decision.plan) == ("modify", story.PLAN)
        assert decision.reason == "back to the plan as it was proposed"


async def test_an_interrupt_says_how_to_leave_and_the_plan_still_waits(show: Show) -> None:
    async with show(story.told("approval")) as (app, pilot, station, clock):
        await press(pilot, "ctrl+c")
        assert notices(app)[-1].startswith("q ^q leaves the console, and asks first")
        clock.now += ARM_DELAY_S
        await press(pilot, "m", "enter")
        await press(pilot, "end", "ctrl+c")
        assert notices(app)[-1].startswith("Esc goes back; there q ^q leaves the console")
        await press(pilot, "escape")
        assert station.decisions == []
        assert app.screen.query_one(ApprovalPanel).display
        await press(pilot, "a", "enter")
        assert station.decided == ["approve"]


async def test_a_request_is_withdrawn_with_its_mission(show: Show) -> None:
    async with show(story.told("approval")) as (app, pilot, station, clock):
        clock.now += ARM_DELAY_S
        await open_editor(app, pilot)
        station.emit(ev.MissionFinished(status="cancelled", reason="stop", metrics=Metrics()))
        await settle(pilot)
        assert app.screen is app.session.main
        assert station.decisions == []
        assert not app.screen.query_one(ApprovalPanel).display


async def test_a_decision_that_was_not_accepted_can_be_made_again(show: Show) -> None:
    async with show(story.told("approval")) as (app, pilot, station, clock):
        clock.now += ARM_DELAY_S
        await open_editor(app, pilot)
        app.screen.query_one(TextArea).text = OWN.model_dump_json()
        await press(pilot, "ctrl+s")
        decision = station.decisions[0]
        station.emit(ev.DecisionMade(attempt=1, decision=decision, accepted=False, detail="no"))
        await settle(pilot)
        clock.now += ARM_DELAY_S
        await press(pilot, "r", "enter")
        assert station.decided == ["modify", "reject"]


async def test_the_attempt_up_for_approval_is_the_one_spread_out(show: Show) -> None:
    worse = ev.PlanProposed(attempt=2, text="{}", plan=None, error="no JSON")
    async with show([*story.told("planning"), *story.judged()[:-1], worse]) as (
        app,
        pilot,
        station,
        _,
    ):
        state = app.session.state.missions[story.MISSION.id]
        assert [part.key for part in sections(state, {})][-2:] == ["heading-2", "plan-2"]
        station.emit(story.judged()[-1])
        await settle(pilot)
        keys = [part.key for part in sections(state, {})]
        assert keys.index("attempt-2") < keys.index("heading-1") < keys.index("plan-1")
        assert "plan-2" not in keys


async def test_the_title_tells_how_old_the_plan_and_its_rehearsal_are(show: Show) -> None:
    made_s = story.rehearsal().before.time_s
    async with show(story.told("approval")) as (app, pilot, station, _):
        panel = app.screen.query_one(ApprovalPanel)
        station.emit(ev.TelemetryReceived(picture=picture(made_s + 45.0)))
        await settle(pilot)
        assert panel.border_title == "✔ Approve · 45 s old"
        now = picture(made_s + 540.0)
        again = story.rehearsal().model_copy(update={"before": now})
        station.emit(
            ev.TelemetryReceived(picture=now),
            ev.PlanRehearsed(attempt=1, rehearsal=again, seconds=0.1),
        )
        await settle(pilot)
        station.emit(ev.TelemetryReceived(picture=now))
        await settle(pilot)
        assert panel.border_title == "✔ Approve · 9 min old, rehearsed just now"
