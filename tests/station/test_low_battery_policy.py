"""The low-battery policy of a world is offered at the start, and acts once it is approved."""

import asyncio
from collections.abc import Callable
from contextlib import aclosing

import pytest

from pa_console.schema.events import event as ev
from pa_console.schema.incident import SetBattery
from pa_console.session.state import SessionState
from pa_console.station import worker
from pa_console.station.assembly import open_station
from pa_console.station.clock import RealTimeClock
from pa_console.station.station import ControlStation
from tests.rig import MISSION, Rig
from tests.scripted import ScriptedEngine, plan

READ = "asked: relieve Drone_T02 at NorthGate"
RELIEF = plan(("Drone_T04", "move_to NorthGate"), ("Drone_T02", "return_to_base"))


async def shift(
    rig: Rig,
    act: Callable[[ev.Event, ControlStation], object],
    until: Callable[[SessionState], object],
    relief: str = RELIEF,
) -> SessionState:
    """Run a session in which the policy is offered, until something holds of its state."""
    station = open_station(
        rig.site, ScriptedEngine([relief] * 4).engine(), RealTimeClock(20.0), respond=True
    )
    station.offer_at_start(rig.site.world.low_battery_policy)
    state = SessionState()
    async with asyncio.timeout(60), aclosing(station.run()) as events:
        async for event in events:
            state.apply(event)
            act(event, station)
            if until(state):
                break
    return state


async def test_it_waits_for_approval_and_then_holds_as_a_standing_order(rig: Rig) -> None:
    def act(event: ev.Event, station: ControlStation) -> None:
        if isinstance(event.data, ev.ApprovalRequested):
            assert event.data.standing is not None
            assert event.data.standing.unasked
            station.decide(event.data.approved())

    state = await shift(rig, act, lambda state: state.standing)
    [order] = state.standing.values()
    assert order.order.text == rig.site.world.low_battery_policy
    assert order.by == "operator"


async def test_every_other_mission_goes_before_the_offer(rig: Rig) -> None:
    def act(event: ev.Event, station: ControlStation) -> None:
        if isinstance(event.data, ev.ApprovalRequested) and event.data.standing is not None:
            station.submit(MISSION)

    def planned(state: SessionState) -> bool:
        request = state.current.approval if state.current is not None else None
        return request is not None and request.standing is None

    state = await shift(rig, act, planned)
    offered, given = state.missions.values()
    assert offered.mission.offered
    assert offered.preempted
    assert state.active == given.mission.id


def approved(event: ev.Event, station: ControlStation) -> None:
    """Approve the policy, and let a battery get low once it holds."""
    match event.data:
        case ev.ApprovalRequested() as asked if asked.standing is not None:
            station.decide(asked.approved())
        case ev.StandingOrderApproved():
            station.inject(SetBattery(asset="Drone_T02", percent=28.0))
        case _:
            pass


async def test_approved_it_relieves_a_drone_while_nobody_answers(rig: Rig) -> None:
    """The scripted models report no confidence, so that its plan waits; it is started at once."""

    def relieves(state: SessionState) -> bool:
        return any(each.starts for each in state.standing.values())

    state = await shift(rig, approved, relieves)
    started = state.missions[next(iter(state.standing.values())).starts[0].mission]
    assert "Drone_T02" in started.mission.text
    assert started.decision is None


async def test_approved_it_needs_no_confidence_of_a_model_in_its_own_words(rig: Rig) -> None:
    def decided(state: SessionState) -> list[str]:
        made = [trace.decision for trace in state.missions.values() if trace.mission.standing]
        return [one.standing_order for one in made if one is not None]

    read = plan(("Drone_T04", "move_to NorthGate"), ("Drone_T02", "return_to_base"), reason=READ)
    state = await shift(rig, approved, decided, read)
    assert decided(state) == ["S1"]


async def test_approved_it_does_not_wait_behind_a_plan_that_nobody_answers(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(worker, "UNANSWERED_S", 2.0)

    def act(event: ev.Event, station: ControlStation) -> None:
        match event.data:
            case ev.ApprovalRequested() as asked if asked.standing is not None:
                station.decide(asked.approved())
            case ev.StandingOrderApproved():
                station.submit(MISSION)
            case ev.ApprovalRequested():
                station.inject(SetBattery(asset="Drone_T02", percent=28.0))
            case _:
                pass

    def both_asked(state: SessionState) -> bool:
        relief, request = [one for one in state.missions.values() if one.mission.standing], None
        if state.current is not None:
            request = state.current.approval
        return bool(relief) and request is not None and state.active == relief[0].mission.id

    state = await shift(rig, act, both_asked)
    _, given, relief = state.missions.values()
    assert given.preempted == f"{relief.mission.id} goes first: {worker.NOBODY_ANSWERS}"
    assert [entry.mission.id for entry in state.queue] == [given.mission.id]
