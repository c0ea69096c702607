"""Who decides when nobody judges, and what a decision that says nothing comes to."""

import pytest

from pa_console.mission.approval import standing_approver
from pa_console.schema.evaluation import Variant
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Decision
from pa_console.session.state import SessionState
from pa_console.station.assembly import open_station
from pa_console.station.clock import SteppedClock
from pa_console.station.headless import run_missions
from tests.rig import MISSION, Rig
from tests.scripted import FAILURE, ScriptedEngine, plan

SPARE = plan(("Drone_T04", "move_to EastGate"))
UNCOVER = plan(("Drone_T01", "move_to EastGate"))


@pytest.mark.parametrize(("answer", "status"), [(SPARE, "verified"), (UNCOVER, "refused")])
async def test_without_judging_the_checks_alone_decide(rig: Rig, answer: str, status: str) -> None:
    engine = ScriptedEngine([answer], [FAILURE])
    station = open_station(
        rig.site, engine.engine(), SteppedClock(), variant=Variant(judging=False)
    )
    events: list[ev.Event] = []

    def sink(event: ev.Event, _: SessionState) -> None:
        events.append(event)

    [trace] = await run_missions(station, [MISSION], standing_approver("auto"), sink)
    assert trace.status == status, trace.reason
    assert {request.role for request in engine.requests} == {"planner"}
    assert not {event.data.kind for event in events} & {"plan_judged", "outcome_judged"}
    asked = [e.data for e in events if isinstance(e.data, ev.ApprovalRequested)]
    assert [bool(request.blocked_by) for request in asked] == [status == "refused"]
    assert not any(request.needs_override for request in asked)


async def test_the_reason_of_a_rejection_is_the_missions(rig: Rig) -> None:
    def reject(_: ev.ApprovalRequested) -> Decision:
        return Decision(kind="reject", reason="not on my watch")

    trace = await rig.run(ScriptedEngine([SPARE]), approver=reject)
    assert (trace.status, trace.reason) == ("rejected", "not on my watch")
    assert trace.commands == {}

    def silently(_: ev.ApprovalRequested) -> Decision:
        return Decision(kind="reject", by="the night shift")

    trace = await rig.run(ScriptedEngine([SPARE]), approver=silently)
    assert (trace.status, trace.reason) == ("rejected", "rejected by the night shift")
