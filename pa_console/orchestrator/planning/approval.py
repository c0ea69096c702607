"""Step 6: what stands between a checked plan and its execution; deterministic checks decide."""

from collections.abc import Iterable, Sequence

from pa_console.schema.events.event import ApprovalRequested
from pa_console.schema.finding import Finding, Verdict
from pa_console.schema.mission import Decision
from pa_console.schema.plan import Action, Plan


def request_approval(  # noqa: PLR0917 - one plan and what was said of it
    request_id: str,
    attempt: int,
    plan: Plan,
    findings: Sequence[Finding],
    verdict: Verdict | None,
    judge_error: str,
    *,
    judging: bool = True,
    asked: str = "",
    readings: Sequence[str] = (),
    if_halted: Sequence[Action] = (),
    gaps: Sequence[str] = (),
    confidence: float | None = None,
    read_apart: bool = False,
) -> ApprovalRequested:
    """Say what nobody may override, what must be acknowledged, and whether the judge objects.

    With `judging`, a plan without a verdict is on hold. The plan is for what was `asked`;
    `readings` are what else was meant, maybe. `if_halted` is approved with the plan. The rest says
    how far the reading can be trusted.
    """
    blocked = [f"{finding.rule_id}: {finding.message}" for finding in findings if finding.blocking]
    if not blocked and judging and verdict is None:
        blocked.append(f"judge: {judge_error or 'no verdict'}; the plan is on hold")
    return ApprovalRequested(
        request_id=request_id,
        attempt=attempt,
        plan=plan,
        blocked_by=tuple(blocked),
        acknowledge=tuple(warnings(findings)),
        needs_override=verdict is not None and verdict.verdict == "Failure",
        asked=asked,
        readings=tuple(readings),
        if_halted=tuple(if_halted),
        gaps=tuple(gaps),
        confidence=confidence,
        read_apart=read_apart,
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
