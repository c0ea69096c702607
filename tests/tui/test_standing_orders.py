"""Standing orders on the screen and in lines: shown before they hold, listed, and revoked."""

import asyncio
from datetime import UTC, datetime
from pathlib import Path

import pytest
from textual.widgets import Button, Static

from pa_console.schema.events import event as ev
from pa_console.schema.mission import Metrics, Schedule, StandingOrder, StandingStart
from pa_console.schema.plan import Plan
from pa_console.schema.text import clock_text
from pa_console.station.earlier.last_session import LastSession
from pa_console.terminal.line_console import LineConsole
from pa_console.terminal.session_lines import LineOutput
from pa_console.tui.app import ConsoleApp
from pa_console.tui.approval.panel import ARM_DELAY_S, ApprovalPanel
from pa_console.tui.approval.plan_words import offered_rows
from pa_console.tui.screens.standing_orders import StandingOrdersScreen
from pa_console.tui.widgets.row_views import TextRows
from pa_console.views.waiting import Waiting
from tests.tui import story
from tests.tui.scripted import ScriptedStation, Show, console, press, settle
from tests.tui.site import picture

pytestmark = pytest.mark.long

TEXT = "Whenever a drone is below 20 %, relieve it."
ORDER = StandingOrder(
    id="S1",
    text=TEXT,
    each="asset",
    condition="it.kind == 'uav' && it.battery_pct < 20.0",
    words="a drone is below 20 % battery",
    order="Relieve {it}.",
)
READ = ev.StandingOrderRead(
    order=ORDER, now=(StandingStart(subject="Drone_T01", order="Relieve Drone_T01."),)
)
REQUEST = ev.ApprovalRequested(
    request_id=f"{story.MISSION.id}.S1",
    attempt=0,
    plan=Plan(reason="none", actions=()),
    standing=ORDER,
    state="approve",
)
GIVEN = story.MISSION.model_copy(update={"text": TEXT})
STARTED = story.MISSION.model_copy(
    update={"id": "M-777", "text": "Relieve Drone_T01.", "source": "standing", "standing": "S1"}
)


def asked() -> list[ev.EventPayload]:
    """Return the events up to a standing order that waits for approval."""
    received = ev.MissionReceived(mission=GIVEN, position=0)
    return [*story.opening(), received, ev.MissionStarted(), READ, REQUEST]


def in_force(station: ScriptedStation) -> None:
    """Let it be approved, start a mission and leave one out."""
    station.emit(ev.StandingOrderApproved(order=ORDER, by="operator"), mission=None)
    station.emit(ev.MissionReceived(mission=STARTED, position=0), mission=STARTED.id)
    started = ev.StandingOrderStarted(order_id="S1", subject="Drone_T01")
    station.emit(started, mission=STARTED.id)
    withheld = ev.StandingOrderWithheld(order_id="S1", subject="Drone_T02", reason="it is busy")
    station.emit(withheld, mission=None)


def words(app: ConsoleApp, sheet: str) -> str:
    return " ".join(str(app.screen.query_one(sheet, TextRows).render()).split())


@pytest.mark.parametrize("size", [(80, 24), (120, 36)])
async def test_it_is_shown_in_words_and_as_cel_and_approved_or_rejected_as_it_is(
    size: tuple[int, int], show: Show
) -> None:
    async with show(asked(), size=size) as (app, pilot, station, clock):
        said = words(app, "#approval-text")
        shown = (TEXT, ORDER.words, ORDER.condition, "Relieve that asset.")
        now = "Drone_T01: Relieve Drone_T01."
        for part in (*shown, "each mission waits for your approval", now):
            assert part in said
        clock.now += ARM_DELAY_S
        app.screen.query_one(ApprovalPanel).refresh_state()
        assert app.screen.query_one("#modify", Button).disabled
        await pilot.press("m", "enter")
        assert station.decisions == []
        await press(pilot, "a", "enter")
        assert station.decided == ["approve"]
        assert station.decisions[0].request_id == REQUEST.request_id


@pytest.mark.parametrize("size", [(60, 18), (120, 36)])
async def test_all_are_listed_with_what_they_have_started_and_can_be_revoked(
    show: Show, size: tuple[int, int]
) -> None:
    async with show(story.opening(), size=size) as (app, pilot, station, _):
        in_force(station)
        await settle(pilot)
        await press(pilot, "escape", "V")
        screen = app.screen
        assert isinstance(screen, StandingOrdersScreen)
        assert "1 standing order in force" in str(screen.query_one("#list-title", Static).render())
        assert "in force" in screen.listing.text
        sheet = words(app, "#list-sheet")
        for part in (ORDER.condition, "M-777 for Drone_T01", "Drone_T02: it is busy"):
            assert part in sheet
        await press(pilot, "x")
        screen.look()
        assert station.changed == [("S1", "revoke")]
        assert "revoked by operator" in words(app, "#list-sheet")
        await pilot.press("x")
        assert station.changed == [("S1", "revoke")], "once"
        await pilot.press("escape")
        assert app.screen is app.session.main


async def test_leaving_with_one_in_force_asks_once_and_says_what_ends(show: Show) -> None:
    async with show(story.opening()) as (app, pilot, station, _):
        in_force(station)
        station.emit(
            ev.MissionFinished(status="held", reason="x", metrics=Metrics()), mission=STARTED.id
        )
        await settle(pilot)
        await press(pilot, "f2", "q", "enter")
        asked_so = str(app.screen.query_one("#confirm Static", Static).render())
        assert "S1" in asked_so
        assert TEXT in asked_so
        await pilot.press("n")
        assert app.is_running


async def test_one_key_gives_those_of_the_last_session_again_and_once(tmp_path: Path) -> None:
    last = LastSession(tmp_path, "0" * 64, "U")
    last.orders = (TEXT,)
    station = ScriptedStation(story.opening())
    async with console(station, tmp_path, last=last).run_test(size=(120, 36)) as pilot:
        await settle(pilot)
        for _ in range(2):
            await press(pilot, "ctrl+n")
    assert station.submitted == [TEXT]


async def test_without_one_the_screen_says_how_to_give_one(show: Show) -> None:
    async with show(story.opening(), size=(80, 24)) as (app, pilot, _, _):
        await press(pilot, "escape", "V")
        assert "Whenever a drone is below 20 %, relieve it." in words(app, "#list-sheet")


async def test_in_line_mode_they_are_lines_and_revoke_ends_one() -> None:
    station = ScriptedStation(story.opening())
    said: list[str] = []
    lines: asyncio.Queue[str | None] = asyncio.Queue()
    listening = LineConsole(
        station,  # pyright: ignore[reportArgumentType] - it has all that is asked of it here
        LineOutput(said.append, lambda _trace, _number: None, lambda _trace: None),
        Waiting(),
    )
    in_force(station)
    running = asyncio.create_task(listening.run(lines))
    while not listening.state.standing.get("S1") or not listening.state.standing["S1"].withheld:
        await asyncio.sleep(0)
    for line in ("standing", "revoke s1", "revoke S9 now"):
        lines.put_nowait(line)
    while not lines.empty() or listening.state.standing["S1"].in_force:
        await asyncio.sleep(0)
    lines.put_nowait("standing")
    while not lines.empty():
        await asyncio.sleep(0)
    station.end()
    await running
    assert "S1: whenever a drone is below 20 % battery: Relieve that asset." in said
    assert any("1 start, last M-777 for Drone_T01" in line for line in said)
    assert station.changed == [("S1", "revoke")]
    assert "no standing orders in force" in said


TIMED = StandingOrder(
    id="S2",
    text="Every ten minutes have Drone_T04 look at the north gate.",
    schedule=Schedule(start=datetime(2026, 3, 1, 16, 45, tzinfo=UTC), every_s=600.0),
    words="every 10 minutes from 16:45",
    order="Have Drone_T04 look at the north gate.",
)
NEXT = ev.StandingOrderScheduled(
    order_id="S2", moment=datetime(2026, 3, 1, 16, 55, tzinfo=UTC), at_s=600.0
)


@pytest.mark.parametrize("size", [(80, 24), (120, 36)])
async def test_a_timed_order_shows_its_moments_and_is_paused_skipped_and_given_again(
    show: Show, size: tuple[int, int]
) -> None:
    async with show(story.opening(), size=size) as (app, pilot, station, _):
        station.emit(ev.StandingOrderApproved(order=TIMED, by="operator"), mission=None)
        station.emit(NEXT, mission=None)
        await settle(pilot)
        await press(pilot, "escape", "V")
        screen = app.screen
        assert isinstance(screen, StandingOrdersScreen)
        left = clock_text(600.0 - app.session.shown_state.time_s)
        assert f"16:55:00 in {left}" in screen.listing.text
        assert "every 10 minutes from 16:45" in words(app, "#list-sheet")
        await press(pilot, "p")
        screen.look()
        assert "paused" in screen.listing.text
        await press(pilot, "p")
        await press(pilot, "s", "x")
        screen.look()
        changes = ["pause", "resume", "skip", "revoke"]
        assert station.changed == [("S2", change) for change in changes]
        await pilot.press("a")
        assert station.submitted == [TIMED.text]


ONCE = StandingOrder(
    id="S3",
    text="At 16:45 send Drone_T04 to the north gate.",
    schedule=Schedule(start=datetime(2026, 3, 1, 16, 45, tzinfo=UTC)),
    words="at 16:45",
    order="Send Drone_T04 to the north gate.",
)


async def test_an_order_for_one_moment_says_when_it_runs_and_counts_down(show: Show) -> None:
    given = story.MISSION.model_copy(update={"text": ONCE.text})
    moments = (ONCE.schedule.start,) if ONCE.schedule is not None else ()
    read = ev.StandingOrderRead(order=ONCE, moments=moments, first_s=660.0)
    request = REQUEST.model_copy(update={"standing": ONCE})
    told = [*story.opening(), ev.MissionReceived(mission=given, position=0), read, request]
    async with show(told) as (app, pilot, station, _):
        said = words(app, "#approval-text")
        assert "Will run once at 16:45:00 UTC" in said
        assert "until you revoke it" not in said
        station.emit(ev.TelemetryReceived(picture=picture(600.0)))
        await settle(pilot)
        assert app.screen.query_one(ApprovalPanel).border_title == "✔ Approve · in 01:00"
        said = words(app, "#approval-text")
        assert "now Send Drone_T04 to the north gate." in said
        done = ev.MissionFinished(
            status="verified", reason="S3 will run once at 16:45:00", metrics=Metrics()
        )
        station.emit(done)
        await settle(pilot)
        assert "✔ approved S3 will run once at 16:45:00" in words_of_head(app)


def words_of_head(app: ConsoleApp) -> str:
    """Return the line of the trace that says what the mission came to."""
    return " ".join(str(app.screen.query_one("#trace-progress", Static).render()).split())


def test_the_panel_shows_the_next_five_moments_and_what_would_be_done_now() -> None:
    assert TIMED.schedule is not None
    now = (StandingStart(order="Have Drone_T04 look at NorthGate."),)
    read = ev.StandingOrderRead(order=TIMED, now=now, moments=tuple(TIMED.schedule.moments(5)))
    told = "\n".join(row.body.plain for row in offered_rows(read))
    assert "16:45:00, 16:55:00, 17:05:00, 17:15:00, 17:25:00 UTC" in told
    assert "Have Drone_T04 look at NorthGate." in told
