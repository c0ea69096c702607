"""Nobody can approve a plan that breaks a Critical or High rule, whatever else they say."""

from hypothesis import given
from hypothesis import strategies as st

from pa_console.mission.approval import CheckedPlan, OrderAsRead, inadmissible, request_approval
from pa_console.schema.finding import Finding, Verdict
from pa_console.schema.mission import Decision
from pa_console.schema.plan import Plan

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
