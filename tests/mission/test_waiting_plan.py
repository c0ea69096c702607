"""A plan that waits is rehearsed again when the situation changes, and withdrawn when it fails."""

import asyncio
from collections.abc import Callable
from contextlib import aclosing

from pa_console.schema.events import event as ev
from pa_console.schema.incident import FailAsset, Incident, SetBattery
from pa_console.session.state import MissionTrace, SessionState
from pa_console.station.assembly import open_station
from pa_console.station.clock import RealTimeClock
from tests.rig import MISSION, Rig
from tests.scripted import ScriptedEngine, plan

SPARE = plan(("Drone_T04", "move_to EastGate"))
OTHER = plan(("Ugv_T02", "move_to EastGate"))


async def wait_while(
    rig: Rig, incident: Incident, until: Callable[[MissionTrace], bool]
) -> MissionTrace:
    """Let a plan wait, make something happen, and return the mission once `until` holds."""
    engine = ScriptedEngine([SPARE, OTHER])
    station = open_station(rig.site, engine.engine(), RealTimeClock(20.0))
    state, given = SessionState(), False
    async with asyncio.timeout(60), aclosing(station.run()) as events:
        async for event in events:
            rig.events.append(event)
            state.apply(event)
            if isinstance(event.data, ev.TelemetryReceived) and not given:
                station.submit(MISSION)
                given = True
            if isinstance(event.data, ev.ApprovalRequested) and event.data.attempt == 1:
                station.inject(incident)
            trace = next(iter(state.missions.values()), None)
            if trace is not None and until(trace):
                return trace
    raise AssertionError("the session ended first")


async def test_a_changed_charge_is_rehearsed_while_the_plan_waits(rig: Rig) -> None:
    def fresh(trace: MissionTrace) -> bool:
        rehearsal = trace.attempts[0].rehearsal if trace.attempts else None
        asset = rehearsal.before.assets["Drone_T04"] if rehearsal is not None else None
        return asset is not None and asset.battery_pct < 75.0

    trace = await wait_while(rig, SetBattery(asset="Drone_T04", percent=70.0), fresh)
    assert trace.approval is not None
    assert trace.approval.attempt == 1, "the same plan still waits"


async def test_a_plan_that_no_longer_holds_is_withdrawn_with_the_reason(rig: Rig) -> None:
    def planned_anew(trace: MissionTrace) -> bool:
        return trace.approval is not None and trace.approval.attempt > 1

    trace = await wait_while(rig, FailAsset(asset="Drone_T04"), planned_anew)
    assert "Drone_T04" in trace.voided
    assert trace.approval is not None
    assert trace.approval.plan.agents == ("Ugv_T02",)
    assert not trace.decisions, "nobody had to decide on it"
