"""Nobody can approve a plan that breaks a Critical or High rule, whatever else they say."""

import asyncio
from collections.abc import Callable
from contextlib import aclosing

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.mission.approval import (
    CheckedPlan,
    OrderAsRead,
    inadmissible,
    request_approval,
)
from pa_console.schema.evaluation import Variant
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Finding, Verdict
from pa_console.schema.incident import FailAsset, Incident, SetBattery
from pa_console.schema.mission import Decision
from pa_console.schema.plan import Plan
from pa_console.session.state import MissionTrace, SessionState
from pa_console.station.assembly import open_station
from pa_console.station.clock import RealTimeClock, SteppedClock
from tests.rig import MISSION, Rig
from tests.scripted import FAILURE, ScriptedEngine, plan

PLAN = Plan(reason="test", actions=())
findings = st.builds(
    Finding,
    rule_id=st.sampled_from(["ROE-02", "WF-03", "WF-07", "CAP-04"]),
    priority=st.sampled_from(["critical", "high", "medium"]),
    status=st.sampled_from(["complies", "violates", "not_applicable", "judged_only", "error"]),
)
verdicts = st.sampled_from([None, Verdict(verdict="Success"), Verdict(verdict="Failure")])
approvals = st.builds(
    Decision,
    kind=st.just("approve"),
    reason=st.sampled_from(["", "  ", "seen it myself"]),
    override_judge=st.booleans(),
    acknowledged=st.sampled_from([(), ("WF-07",), ("ROE-02", "WF-03", "WF-07", "CAP-04")]),
)


@given(st.lists(findings, max_size=6), verdicts, approvals)
def test_approval_needs_every_condition(
    found: list[Finding], verdict: Verdict | None, decision: Decision
) -> None:
    request = request_approval("M1.1", 1, CheckedPlan(PLAN, found, verdict), OrderAsRead())
    broken = [f for f in found if f.status in ("violates", "error")]
    sound = not any(f.priority in ("critical", "high") for f in broken)
    acknowledged = all(f.rule_id in decision.acknowledged for f in broken)
    agreed = verdict is not None and (
        verdict.verdict == "Success" or (decision.override_judge and decision.reason.strip() != "")
    )
    assert (inadmissible(request, decision) == "") == (sound and acknowledged and agreed)


@given(st.lists(findings, max_size=4), verdicts)
def test_a_plan_can_always_be_rejected(found: list[Finding], verdict: Verdict | None) -> None:
    request = request_approval(
        "M1.1", 1, CheckedPlan(PLAN, found, verdict, "timed out"), OrderAsRead()
    )
    assert inadmissible(request, Decision(kind="reject")) == ""


def test_a_modified_plan_must_be_there() -> None:
    request = request_approval("M1.1", 1, CheckedPlan(PLAN, judge_error="timed out"), OrderAsRead())
    assert "missing" in inadmissible(request, Decision(kind="modify"))
    assert inadmissible(request, Decision(kind="modify", plan=PLAN)) == ""


def test_the_reason_for_a_missing_verdict_is_told() -> None:
    request = request_approval(
        "M1.1", 1, CheckedPlan(PLAN, judge_error="no answer within 30 s"), OrderAsRead()
    )
    assert request.blocked_by == ("judge: no answer within 30 s; the plan is on hold",)


def test_a_decision_about_another_plan_is_not_taken_for_this_one() -> None:
    request = request_approval(
        "M1.2", 2, CheckedPlan(PLAN, verdict=Verdict(verdict="Success")), OrderAsRead()
    )
    late = Decision(kind="approve", request_id="M1.1")
    assert "another plan" in inadmissible(request, late)
    assert inadmissible(request, Decision(kind="approve", request_id="M1.2")) == ""


SPARE = plan(("Drone_T04", "move_to EastGate"))
UNCOVER = plan(("Drone_T01", "move_to EastGate"))


@pytest.mark.parametrize(("answer", "status"), [(SPARE, "verified"), (UNCOVER, "refused")])
async def test_without_judging_the_checks_alone_decide(rig: Rig, answer: str, status: str) -> None:
    engine = ScriptedEngine([answer], [FAILURE])
    station = open_station(
        rig.site, engine.engine(), SteppedClock(), variant=Variant(judging=False)
    )
    [trace] = await rig.carry_out(station, [MISSION])
    assert trace.status == status, trace.reason
    assert {request.role for request in engine.requests} == {"planner"}
    assert not {*rig.kinds()} & {"plan_judged", "outcome_judged"}
    asked = [e.data for e in rig.events if isinstance(e.data, ev.ApprovalRequested)]
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
