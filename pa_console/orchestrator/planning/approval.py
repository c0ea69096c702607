"""Step 6: what stands between a checked plan and its execution; deterministic checks decide."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

from pa_console.schema.events.event import ApprovalRequested
from pa_console.schema.finding import Finding, Verdict
from pa_console.schema.mission import ApprovalState, Decision
from pa_console.schema.plan import Action, Plan
from pa_console.session.confidence import UNSURE

NOT_BEFOREHAND = "a standing order is approved by somebody who reads it, and nobody did"


@dataclass(frozen=True)
class CheckedPlan:
    """A plan, what the checks found of it, and what the judge said or why it did not."""

    plan: Plan
    findings: Sequence[Finding] = ()
    verdict: Verdict | None = None
    judge_error: str = ""


@dataclass(frozen=True)
class OrderAsRead:
    """The reading that a plan serves, and the evidence for it."""

    asked: str = ""
    readings: tuple[str, ...] = ()
    """Other possible readings."""
    gaps: tuple[str, ...] = ()
    """Words of the order that the reading does not account for."""
    confidence: float | None = None
    read_apart: bool = False
    """True if another reader, second model or judge, reads the order differently."""
    narrowed: bool = False
    """True if the plan leaves out a part of the order."""
    question: str = ""
    """The question about an order that was not understood; '' if it was."""


def approval_state(read: OrderAsRead, *, blocked: bool, objected: bool) -> ApprovalState:
    """Return the approval state of a plan; no other place decides it.

    A plan is `approve` only if no evidence speaks against its reading.
    """
    if read.question:
        return "not_understood"
    if blocked:
        return "blocked"
    if objected:
        return "judge_objects"
    unsure = read.confidence is not None and read.confidence < UNSURE
    if unsure or read.gaps or read.read_apart:
        return "may_be_misunderstood"
    return "narrowed" if read.narrowed else "approve"


def request_approval(
    request_id: str,
    attempt: int,
    checked: CheckedPlan,
    read: OrderAsRead,
    *,
    judging: bool = True,
    if_halted: Sequence[Action] = (),
) -> ApprovalRequested:
    """Return the request: hard blocks, points to acknowledge, and the judge's objection.

    With `judging`, a plan without a verdict is on hold. `if_halted` is approved with the plan. For
    an order that was not understood no plan and no other reading are proposed.
    """
    if read.question:
        return _ask_back(request_id, attempt, read.question)
    verdict, findings = checked.verdict, checked.findings
    blocked = [f"{finding.rule_id}: {finding.message}" for finding in findings if finding.blocking]
    if not blocked and judging and verdict is None:
        blocked.append(f"judge: {checked.judge_error or 'no verdict'}; the plan is on hold")
    objected = verdict is not None and verdict.verdict == "Failure"
    return ApprovalRequested(
        request_id=request_id,
        attempt=attempt,
        plan=checked.plan,
        blocked_by=tuple(blocked),
        acknowledge=tuple(warnings(findings)),
        needs_override=objected,
        asked=read.asked,
        readings=read.readings,
        if_halted=tuple(if_halted),
        gaps=read.gaps,
        confidence=read.confidence,
        read_apart=read.read_apart,
        state=approval_state(read, blocked=bool(blocked), objected=objected),
    )


def _ask_back(request_id: str, attempt: int, question: str) -> ApprovalRequested:
    return ApprovalRequested(
        request_id=request_id,
        attempt=attempt,
        plan=Plan(reason="the order was not understood", actions=()),
        blocked_by=(f"not understood: {question}",),
        state=approval_state(OrderAsRead(question=question), blocked=True, objected=False),
    )


def warnings(findings: Iterable[Finding]) -> list[str]:
    """Return the ids of broken rules that an operator may accept (Medium priority)."""
    return [finding.rule_id for finding in findings if finding.broken and not finding.blocking]


def people_needed(
    request: ApprovalRequested, approvals: Mapping[str, int], fresh: Collection[str] = ()
) -> dict[str, int]:
    """Return what of `request` more than one person must approve by the rules, and how many.

    `approvals` is what the rules say; `fresh` are the agents that were never given an order.
    """
    actions = (*request.plan.actions, *request.if_halted)
    acts = dict.fromkeys(action.verb for action in actions)
    named: list[str] = list(acts)
    if request.needs_override:
        named.append("override")
    if request.acknowledge:
        named.append("acknowledge")
    if any(action.agent in fresh and action.verb != "hold" for action in actions):
        named.append("first_order")
    return {act: people for act in named if (people := approvals.get(act, 1)) > 1}


_ACTS = {
    "override": "overriding the judge",
    "acknowledge": "acknowledging a broken rule",
    "first_order": "the first order to a vehicle",
}


def people_words(needed: Mapping[str, int]) -> str:
    """Return in words what more than one person must approve."""
    said = (f"{_ACTS.get(act, act)} needs {people} people" for act, people in needed.items())
    return ", ".join(said)


def inadmissible(
    request: ApprovalRequested,
    decision: Decision,
    needed: Mapping[str, int] | None = None,
    people: int = 1,
) -> str:
    """Return why `decision` cannot be accepted for `request`, or an empty text.

    So many `people` have approved; `needed` is what more than one must approve.
    """
    if decision.request_id not in ("", request.request_id):
        return "the decision was about another plan, which no longer waits"
    if decision.kind == "reject":
        return ""
    if decision.kind == "answer":
        return _not_answerable(request, decision)
    if request.state == "not_understood":
        return f"{'; '.join(request.blocked_by)} Reject it and say it anew"
    if decision.kind in ("modify", "choose"):
        return _not_changeable(request, decision)
    if problem := _not_approvable(request, decision):
        return problem
    lacking = {act: asked for act, asked in (needed or {}).items() if people < asked}
    return f"{people_words(lacking)} to approve, so far there is {people}" if lacking else ""


def _not_answerable(request: ApprovalRequested, decision: Decision) -> str:
    if request.state != "not_understood":
        return "nothing was asked"
    return "" if decision.asked.strip() else "the answer is empty"


def _not_changeable(request: ApprovalRequested, decision: Decision) -> str:
    if request.standing is not None:
        return "a standing order is taken as it is; reject it and say it anew"
    if decision.kind == "modify":
        return "" if decision.plan is not None else "a modified plan is missing"
    return "" if decision.asked in request.readings else "no such reading was offered"


def _not_approvable(request: ApprovalRequested, decision: Decision) -> str:
    if request.standing is not None and decision.standing:
        return NOT_BEFOREHAND
    if request.blocked_by:
        return f"the plan cannot be approved by anyone: {'; '.join(request.blocked_by)}"
    missing = [rule for rule in request.acknowledge if rule not in decision.acknowledged]
    if missing:
        return f"acknowledge the broken rules first: {', '.join(missing)}"
    if request.needs_override and not (decision.override_judge and decision.reason.strip()):
        return "the judge said Failure: overriding it needs a reason"
    return ""
