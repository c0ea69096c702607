"""Typing a mission, watching it, cancelling it."""

import json
from pathlib import Path
from typing import cast

import pytest
from textual import events
from textual.containers import VerticalScroll
from textual.widget import Widget

from pa_console.schema.events import event as ev
from pa_console.tui.app import ConsoleApp
from pa_console.tui.widgets.bars import StatusBar
from pa_console.tui.widgets.map_view import MapView
from pa_console.tui.widgets.mission_prompt import MissionInput, MissionPrompt
from pa_console.tui.widgets.row_views import EventList, TextRows, VirtualRows
from pa_console.tui.widgets.trace_pane import SectionTitle, SectionView
from tests.tui import story
from tests.tui.scripted import ScriptedStation, Show, console, notices, press, settle

SIZE = (120, 36)
TOLD = (
    "Rules retrieved",
    "jaccard 0.30",
    "identify NorthGate",
    "Rehearsal",
    "every checked rule holds",
    "Success",
    "approved",
    "2 of 2 done",
    "Verification",
    "was identified unauthorized",
    "end to end 46.0 s",
)


def shown(app: ConsoleApp, selector: str = "#trace") -> str:
    """The text of a pane as a person would read it, line breaks taken out."""
    assert app.session.main is not None
    pane = app.session.main.query_one(selector)
    widgets = [pane, *pane.walk_children(Widget)]
    parts = (
        widget.text if isinstance(widget, VirtualRows) else str(cast(object, widget.render()))
        for widget in widgets
    )
    return " ".join(" ".join(parts).split())


def shown_title(view: SectionView) -> str:
    """The title of a section with its fold sign."""
    return str(view.query_one(SectionTitle).render())


async def test_a_typed_mission_is_submitted_and_remembered(tmp_path: Path, show: Show) -> None:
    async with show(story.opening()) as (app, pilot, station, _):
        await pilot.press(*"go east", "enter")
        assert station.submitted == ["go east"]
        field = app.screen.query_one(MissionInput)
        assert field.text == ""
        await pilot.press("n", "e", "w", "up")
        assert field.text == "go east"
        await pilot.press("down")
        assert field.text == "new"
    assert "go east" in (tmp_path / "history.txt").read_text()


async def test_a_refused_mission_stays_in_the_field(show: Show) -> None:
    station = ScriptedStation(story.opening())
    station.refuse = "the queue is full"
    async with show(station) as (app, pilot, _, _):
        await pilot.press(*"go east", "enter")
        assert app.screen.query_one(MissionInput).text == "go east"
        assert notices(app) == ["the queue is full"]


async def test_enter_sends_the_text_of_its_moment_however_late_it_is_handled(show: Show) -> None:
    async with show(story.opening()) as (app, pilot, station, _):
        field = app.screen.query_one(MissionInput)
        field.text = "go north"
        field.action_send()
        field.text = "go east"
        await settle(pilot)
        assert station.submitted == ["go north"]


async def test_escape_leaves_the_field_and_keeps_the_text(show: Show) -> None:
    async with show(story.opening()) as (app, pilot, _, _):
        await pilot.press(*"half", "escape", "i")
        field = app.screen.query_one(MissionInput)
        assert field.text == "half"
        assert field.has_focus


async def test_the_trace_tells_the_whole_mission(show: Show) -> None:
    async with show(story.told("finished")) as (app, _, _, _):
        text = shown(app)
        for words in TOLD:
            assert words in text


async def test_a_short_trace_begins_below_its_headline_and_a_long_one_shows_its_end(
    show: Show,
) -> None:
    async with show(story.told("planning"), size=(120, 90)) as (app, pilot, station, _):
        body = app.screen.query_one("#trace-body", VerticalScroll)
        assert app.screen.query(SectionView)
        assert (body.scroll_offset.y, body.max_scroll_y) == (0, 0)
        await pilot.resize_terminal(120, 30)
        for payload in story.told("finished")[len(story.told("planning")) :]:
            station.emit(payload)
        await settle(pilot)
        assert body.scroll_offset.y == body.max_scroll_y > 0


async def test_the_first_words_of_an_answer_are_shown_when_they_come(show: Show) -> None:
    *before, words = story.told("planning")
    async with show(before) as (app, pilot, station, _):
        plan = next(view for view in app.screen.query(SectionView) if "Plan" in shown_title(view))
        assert not plan.query_one(TextRows).display
        station.emit(words)
        await settle(pilot)
        assert plan.query_one(TextRows).display


async def test_the_json_of_a_plan_stays_folded_in_its_place(show: Show) -> None:
    async with show(story.told("approval"), size=(200, 60)) as (app, pilot, _, _):
        view = next(v for v in app.screen.query(SectionView) if "as JSON" in shown_title(v))
        rows = view.query_one(TextRows)
        assert not rows.display
        view.action_fold()
        await settle(pilot)
        assert rows.display
        written = rows.render()
        assert '{"agent": "Drone_T04", "command": "observe NorthGate"},' in written.plain
        assert len({str(span.style) for span in written.spans}) >= 3
        json.loads(" ".join(written.plain.split()))


async def test_retrieved_rules_come_before_those_that_every_mission_has(show: Show) -> None:
    async with show(story.told("planning")) as (app, _, _, _):
        text = shown(app)
        places = [text.index(f"{rule} ") for rule in ("WF-03", "ROE-02", "ROE-01")]
        assert places == sorted(places)


async def test_what_would_turn_an_order_round_is_seen_and_has_its_width(show: Show) -> None:
    order = "Do \u202eton\u202c go \u2066east"
    mission = story.MISSION.model_copy(update={"text": order})
    received = ev.MissionReceived(mission=mission, position=0)
    async with show([*story.opening(), received, ev.MissionStarted()]) as (app, pilot, _, _):
        seen = "Do \\u202eton\\u202c go \\u2066east"
        assert seen in shown(app, "#trace-head")
        assert seen in app.screen.query_one(EventList).text
        app.post_message(events.Paste(order))
        await settle(pilot)
        assert app.screen.query_one(MissionInput).text == seen


async def test_model_text_is_never_read_as_markup(show: Show) -> None:
    async with show(story.told("planning")) as (app, pilot, station, _):
        station.emit(ev.TextStreamed(role="planner", attempt=1, text="[red]x[/nosuch] [@click=a]"))
        await settle(pilot)
        assert "[red]x[/nosuch] [@click=a]" in shown(app)


async def test_telemetry_moves_the_map_while_the_trace_stays(show: Show) -> None:
    async with show(story.told("planning")) as (app, pilot, station, _):
        before = app.screen.query_one(MapView).text()
        station.emit(ev.TelemetryReceived(picture=story.moving_picture()), mission=None)
        await settle(pilot)
        after = app.screen.query_one(MapView).text()
        assert after != before
        assert "◇" in after
        assert "SouthGate UNCOVERED" in str(app.screen.query_one(StatusBar).render())


async def test_cancel_reaches_the_station_at_once(show: Show) -> None:
    async with show(story.told("planning")) as (app, pilot, station, _):
        await press(pilot, "f8")
        assert station.cancelled == 1
        assert "cancelled" in shown(app)
        await pilot.press("f8")
        assert station.cancelled == 1


async def test_a_broken_stream_leaves_the_console_usable(show: Show) -> None:
    broken = ScriptedStation(story.told("planning"), broken="the link is gone")
    async with show(broken) as (app, pilot, station, _):
        station.end()
        await settle(pilot)
        assert sum("the link is gone" in text for text in notices(app)) == 1
        await pilot.press("f6")
        await pilot.pause()
        assert app.screen.query("#policy-list")


async def test_leaving_during_a_mission_asks_first(show: Show) -> None:
    async with show(story.told("executing")) as (app, pilot, station, _):
        await pilot.press("ctrl+q")
        await pilot.pause()
        assert app.screen.query("#confirm")
        await pilot.press("enter")
        await pilot.pause()
        assert not station.closed
        await pilot.press("ctrl+q")
        await pilot.pause()
        await pilot.press("y")
        await pilot.pause()
    assert station.closed


async def test_a_frame_that_falls_due_while_the_console_closes_does_no_harm(show: Show) -> None:
    async with show(story.told("planning")) as (app, _, _, _):
        pass
    assert not app.screen_stack
    app.feed.flush()


async def test_a_timer_that_fires_while_the_console_closes_finds_nothing_to_paint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    station = ScriptedStation(story.opening())
    app = console(station, tmp_path)
    fired: list[bool] = []

    def fire(prompt: MissionPrompt) -> None:
        fired.append(bool(prompt.query(MissionInput)))
        app.feed.look()
        app.feed.flush()

    monkeypatch.setattr(MissionPrompt, "on_unmount", fire, raising=False)
    async with app.run_test(size=SIZE) as pilot:
        await settle(pilot)
    assert fired == [False]  # its field was gone already


async def test_the_key_that_leads_to_the_prompt_is_no_part_of_a_mission(show: Show) -> None:
    async with show(story.opening()) as (app, pilot, _, _):
        await pilot.press("slash", *"hold 1", "slash", "2")
        assert app.screen.query_one(MissionInput).text == "hold 1/2"


async def test_what_is_typed_while_an_order_is_being_taken_stays_in_the_prompt(show: Show) -> None:
    async with show(story.opening()) as (app, pilot, station, _):
        prompt = app.screen.query_one(MissionPrompt)
        prompt.put("Hold all drones.Send")
        await pilot.pause()
        prompt.post_message(MissionPrompt.Given("Hold all drones."))
        await pilot.pause()
        assert station.submitted == ["Hold all drones."]
        assert prompt.draft == "Send"
        await pilot.press(*" one")
        assert prompt.draft == "Send one"
