"""Step 6: what stands between a checked plan and its execution; deterministic checks decide."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from pa_console.schema.events.event import ApprovalRequested
from pa_console.schema.finding import Finding, Verdict
from pa_console.schema.mission import Decision
from pa_console.schema.plan import Action, Plan


@dataclass(frozen=True)
class CheckedPlan:
    """A plan, what the checks found of it, and what the judge said or why it did not."""

    plan: Plan
    findings: Sequence[Finding] = ()
    verdict: Verdict | None = None
    judge_error: str = ""


@dataclass(frozen=True)
class OrderAsRead:
    """What the plan is for, and how far that can be trusted."""

    asked: str = ""
    readings: tuple[str, ...] = ()
    """What else was meant, maybe."""
    gaps: tuple[str, ...] = ()
    """Words of the order that the reading does not account for."""
    confidence: float | None = None
    read_apart: bool = False
    """Whether planner and judge have read the order apart."""


def request_approval(
    request_id: str,
    attempt: int,
    checked: CheckedPlan,
    read: OrderAsRead,
    *,
    judging: bool = True,
    if_halted: Sequence[Action] = (),
) -> ApprovalRequested:
    """Say what nobody may override, what must be acknowledged, and whether the judge objects.

    With `judging`, a plan without a verdict is on hold. `if_halted` is approved with the plan.
    """
    verdict, findings = checked.verdict, checked.findings
    blocked = [f"{finding.rule_id}: {finding.message}" for finding in findings if finding.blocking]
    if not blocked and judging and verdict is None:
        blocked.append(f"judge: {checked.judge_error or 'no verdict'}; the plan is on hold")
    return ApprovalRequested(
        request_id=request_id,
        attempt=attempt,
        plan=checked.plan,
        blocked_by=tuple(blocked),
        acknowledge=tuple(warnings(findings)),
        needs_override=verdict is not None and verdict.verdict == "Failure",
        asked=read.asked,
        readings=read.readings,
        if_halted=tuple(if_halted),
        gaps=read.gaps,
        confidence=read.confidence,
        read_apart=read.read_apart,
    )


def warnings(findings: Iterable[Finding]) -> list[str]:
    """Return the ids of broken rules that an operator may accept (Medium priority)."""
    return [finding.rule_id for finding in findings if finding.broken and not finding.blocking]


def inadmissible(request: ApprovalRequested, decision: Decision) -> str:
    """Return why `decision` cannot be accepted for `request`, or an empty text."""
    if decision.request_id not in ("", request.request_id):
        return "the decision was about another plan, which no longer waits"
    if decision.kind == "modify":
        return "" if decision.plan is not None else "a modified plan is missing"
    if decision.kind == "reject":
        return ""
    if decision.kind == "choose":
        return "" if decision.asked in request.readings else "no such reading was offered"
    if request.blocked_by:
        return f"the plan cannot be approved by anyone: {'; '.join(request.blocked_by)}"
    missing = [rule for rule in request.acknowledge if rule not in decision.acknowledged]
    if missing:
        return f"acknowledge the broken rules first: {', '.join(missing)}"
    if request.needs_override and not (decision.override_judge and decision.reason.strip()):
        return "the judge said Failure: overriding it needs a reason"
    return ""
