"""Plans side by side at an approval: looked at, and put forward; nothing is approved there."""

from typing import Any

import pytest
from textual.pilot import Pilot
from textual.widgets import Static

from pa_console.schema.events import event as ev
from pa_console.schema.mission import Metrics
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import RehearsedReading
from pa_console.tui.app import ConsoleApp
from pa_console.tui.approval.comparison import CandidateColumn, PlanComparison
from pa_console.tui.approval.panel import ARM_DELAY_S
from pa_console.tui.widgets.row_views import TextRows
from tests.tui import story
from tests.tui.scripted import FakeClock, ScriptedStation, Show, press, settle, until

pytestmark = pytest.mark.long

READING = "asked: 1 drone to WestGate"
OTHER = Plan(reason=READING, actions=(Action(agent="Drone_T04", command="move_to WestGate"),))
WAY = Plan(reason=story.ASKED, actions=(Action(agent="Ugv_T02", command="move_to NorthGate"),))


def rehearsed(plan: Plan) -> RehearsedReading:
    return RehearsedReading(plan=plan, rehearsal=story.rehearsal())


async def opened(
    pilot: Pilot[Any], app: ConsoleApp, station: ScriptedStation, clock: FakeClock
) -> PlanComparison:
    """Open the comparison once the panel takes keys."""
    await settle(pilot)
    clock.now += ARM_DELAY_S
    await pilot.press("alt+c")
    await until(pilot, lambda: isinstance(app.screen, PlanComparison))
    await settle(pilot)
    assert isinstance(app.screen, PlanComparison)
    return app.screen


def waiting(*ways: Plan) -> ScriptedStation:
    station = ScriptedStation(story.told("approval", readings=(READING,)))
    station.rehearsed[READING] = rehearsed(OTHER)
    station.ways = [rehearsed(way) for way in ways]
    return station


def said(column: CandidateColumn) -> str:
    return " ".join(column.query_one(TextRows).render().plain.split())


@pytest.mark.parametrize("size", [(80, 24), (120, 36)])
async def test_readings_and_ways_stand_beside_the_plan_with_all_that_tells_them_apart(
    size: tuple[int, int], show: Show
) -> None:
    async with show(waiting(WAY, OTHER), size=size) as (app, pilot, station, clock):
        screen = await opened(pilot, app, station, clock)
        await until(pilot, lambda: len(screen.columns) == 3)
        await settle(pilot)
        titles = [str(column.border_title) for column in screen.columns]
        assert titles == [
            "The plan that waits", "(Alt+1) another reading", "(Alt+2) another way",
        ]  # fmt: skip
        for column in screen.columns:
            for part in ("read as", "Guards", "time", "battery", "rules", "judge", "confidence"):
                assert part in said(column)
        assert "send 1 drone to WestGate" in said(screen.columns[1])
        xs = {column.region.x for column in screen.columns}
        assert len(xs) == (1 if size[0] < 100 else 3), "a list where there is no room for columns"
        assert station.decisions == []
        await pilot.press("escape")
        assert app.screen is app.session.main


@pytest.mark.parametrize(
    ("keys", "kind"),
    [
        (("alt+1", "enter"), "choose"),
        (("alt+2", "enter"), "modify"),
        (("enter",), ""),
        (("a", "r", "m", "space", "alt+2", "escape"), ""),
    ],
)
async def test_what_is_chosen_is_put_forward_and_never_approved(
    keys: tuple[str, ...], kind: str, show: Show
) -> None:
    async with show(waiting(WAY)) as (app, pilot, station, clock):
        screen = await opened(pilot, app, station, clock)
        await until(pilot, lambda: len(screen.columns) == 3)
        await press(pilot, *keys)
        assert station.decided == ([kind] if kind else [])
        if kind == "modify":
            assert station.decisions[0].plan == WAY
        if kind == "choose":
            assert station.decisions[0].asked == READING


async def test_what_is_being_rehearsed_is_said_and_can_be_left(show: Show) -> None:
    station, clock = waiting(WAY), FakeClock()
    station.slow.clear()
    async with show(station, clock=clock) as (app, pilot, station, _):
        screen = await opened(pilot, app, station, clock)
        note = str(screen.query_one("#comparison-note", Static).render())
        assert "rehearsing another way" in note
        assert "Esc stops" in note
        await press(pilot, "escape")
        station.slow.set()
        await settle(pilot)
        assert app.screen is app.session.main
        assert not [worker for worker in app.workers if worker.group == "comparison"]


async def test_it_is_closed_when_the_plan_no_longer_waits(show: Show) -> None:
    async with show(waiting(WAY)) as (app, pilot, station, clock):
        await opened(pilot, app, station, clock)
        over = ev.MissionFinished(status="cancelled", reason="it is over", metrics=Metrics())
        station.emit(over)
        await settle(pilot)
        await until(pilot, lambda: app.screen is app.session.main)
        assert station.decisions == []


async def test_before_the_panel_takes_keys_it_does_not_open(show: Show) -> None:
    async with show(waiting(WAY)) as (app, pilot, _, _):
        await press(pilot, "alt+c")
        assert app.screen is app.session.main
