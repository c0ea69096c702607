"""Timed orders in a session: approved first, then each moment starts a mission of its own."""

from collections.abc import Callable

import pytest

from pa_console.mission.approval import Approver, standing_approver
from pa_console.schema.events import event as ev
from pa_console.session.state import SessionState
from pa_console.station.station import ControlStation
from pa_console.views.event_words import event_in_words
from tests.mission.test_standing_orders import missions_of, person, play, told
from tests.rig import Rig
from tests.scripted import ScriptedEngine, plan

EAST = plan(("Drone_T04", "move_to EastGate"), reason="so be it")
BACK = plan(("Drone_T04", "return_to_base"), reason="so be it")


def nothing(_: ev.Event, __: ControlStation) -> None:
    """Let things happen as they do."""


async def given(
    rig: Rig,
    text: str,
    *,
    on_event: Callable[[ev.Event, ControlStation], None] = nothing,
    approver: Approver = person,
    seconds: float = 60.0,
    plans: tuple[str, ...] = (EAST,),
) -> SessionState:
    """Give a timed order and let some time pass."""
    engine = ScriptedEngine(list(plans))
    return await play(rig, approver, text, on_event=on_event, engine=engine, seconds=seconds)


async def test_it_is_shown_with_its_moments_and_starts_nothing_before_its_moment(
    rig: Rig,
) -> None:
    state = await given(rig, "In ten seconds send Drone_T04 to the east gate.", seconds=5.0)
    (trace,) = state.missions.values()
    assert trace.standing is not None
    assert trace.standing.order.order == "Send Drone_T04 to the east gate."
    assert len(trace.standing.moments) == 1
    assert [start.order for start in trace.standing.now] == ["Send Drone_T04 to the east gate."]
    assert missions_of(state) == []


async def test_a_moment_starts_one_mission_that_waits_for_approval_and_the_order_is_over(
    rig: Rig,
) -> None:
    state = await given(rig, "In ten seconds send Drone_T04 to the east gate.")
    assert missions_of(state) == ["Send Drone_T04 to the east gate."]
    (began,) = told(rig, ev.StandingOrderStarted)
    (approved,) = told(rig, ev.StandingOrderApproved)
    assert (began.tick - approved.tick) * 0.1 == pytest.approx(10.0, abs=1.5)
    assert state.standing["S1"].ended == "its last scheduled time has passed"


@pytest.mark.parametrize(
    ("then", "place"), [("and then back", "Checkpoint"), (", then RTB", "base")]
)
async def test_whoever_stays_goes_back_when_the_time_is_over(
    rig: Rig, then: str, place: str
) -> None:
    order = f"Drone_T04 to the east gate for ten seconds {then}"
    state = await given(rig, order, plans=(EAST, BACK), seconds=120.0)
    assert missions_of(state) == ["Drone_T04 to the east gate", f"Send Drone_T04 back to {place}."]


async def test_it_is_not_given_by_an_instruction(rig: Rig) -> None:
    state = await given(
        rig, "Every minute send Drone_T04 to the east gate.", approver=standing_approver("auto")
    )
    assert state.standing == {}


async def test_a_stop_and_a_revocation_start_nothing(rig: Rig) -> None:
    def stops(event: ev.Event, station: ControlStation) -> None:
        if isinstance(event.data, ev.StandingOrderApproved):
            station.stop_all()

    state = await given(
        rig, "In ten seconds send Drone_T04 to the east gate.", on_event=stops, seconds=30.0
    )
    assert missions_of(state) == []
    (withheld,) = told(rig, ev.StandingOrderWithheld)
    assert "everything is stopped" in event_in_words(withheld.data)


async def test_it_is_paused_skipped_and_revoked_by_words(rig: Rig) -> None:
    def changes(event: ev.Event, station: ControlStation) -> None:
        match event.data:
            case ev.StandingOrderApproved():
                station.submit("skip the next one, then carry on as normal")
            case ev.StandingOrderScheduled(change="skipped"):
                station.submit("pause the east gate run")
            case ev.StandingOrderScheduled(change="paused"):
                station.submit("resume S1")
            case ev.StandingOrderScheduled(change="resumed"):
                station.submit("stop the run to the east gate")
            case _:
                pass

    state = await given(
        rig, "In one minute and then every ten minutes send Drone_T04 to the east gate.",
        on_event=changes, seconds=90.0,
    )  # fmt: skip
    assert missions_of(state) == []
    assert state.standing["S1"].ended == "revoked by operator"
    done = [t.reason for t in state.missions.values() if t.status == "verified"]
    assert done[1:] == ["skipped once: S1", "paused: S1", "resumed: S1", "revoked: S1"]


async def test_a_held_mission_is_an_alarm(rig: Rig) -> None:
    text = "In ten seconds send Drone_T04 to the east gate."
    state = await given(rig, text, plans=("nothing",))
    (mission,) = [t for t in state.missions.values() if t.mission.standing]
    assert mission.status == "held"
    alarms = [e.data.text for e in told(rig, ev.Noticed) if isinstance(e.data, ev.Noticed)]
    assert any(mission.mission.id in text and text.startswith("S1, ") for text in alarms)
