"""Step 7: the fixed conditions under which a checked plan may be approved.

A standing instruction or a standing order may approve a plan without an operator. No person sees
that plan, so it needs a higher confidence and must meet stricter rules.
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from pa_console.schema.command import STILL, Verb
from pa_console.schema.events import event as ev
from pa_console.schema.events.event import ApprovalRequested
from pa_console.schema.finding import Finding, Verdict
from pa_console.schema.mission import STANDING, ApprovalState, Decision, StandingOrder
from pa_console.schema.plan import Action, Plan
from pa_console.session.confidence import UNSURE
from pa_console.views.status_words import status_of

NOT_BEFOREHAND = "a standing order is approved by somebody who reads it, and nobody did"
NOT_FOR_AGENTS = "an agent has proposed it, so somebody has to look at it"

_ACTS = {
    "override": "overriding the judge",
    "acknowledge": "acknowledging a broken rule",
    "first_order": "the first order to a vehicle",
}

SURE_ENOUGH = 0.9
"""The least confidence in its reading that a plan needs to be approved by a standing order."""

Approver = Callable[[ev.ApprovalRequested], Decision]
ApprovalMode = Literal["auto", "never"]


@dataclass(frozen=True)
class CheckedPlan:
    """A plan with its findings and the judge's verdict, or the reason why there is no verdict."""

    plan: Plan
    findings: Sequence[Finding] = ()
    verdict: Verdict | None = None
    judge_error: str = ""


@dataclass(frozen=True)
class OrderAsRead:
    """The reading that a plan serves, and the evidence about it."""

    asked: str = ""
    readings: tuple[str, ...] = ()
    """Other possible readings."""
    gaps: tuple[str, ...] = ()
    """Words of the order that the reading does not account for."""
    confidence: float | None = None
    read_apart: bool = False
    """True if another reader (second reader or judge) reads the order differently."""
    narrowed: bool = False
    """True if the plan leaves out a part of the order."""
    question: str = ""
    """The question about an order that was not understood; '' if it was understood."""


def approval_state(
    read: OrderAsRead, *, blocked: bool, objected: bool, warned: bool = False
) -> ApprovalState:
    """Return the approval state of a plan; no other place decides it.

    The state is `approve` only if there is no evidence against the reading and no rule is broken.
    It is `warned` if a rule of Medium priority is broken.
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
    if warned:
        return "warned"
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
    """Return the request for approval, with all that blocks the plan or must be accepted.

    With `judging`, a plan without a verdict is on hold. `if_halted` is the way to safety, which is
    approved with the plan. If the order was not understood, the request has no plan and no other
    reading.
    """
    if read.question:
        return ApprovalRequested(
            request_id=request_id,
            attempt=attempt,
            plan=Plan(reason="the order was not understood", actions=()),
            blocked_by=(f"not understood: {read.question}",),
            state="not_understood",
        )
    verdict, findings = checked.verdict, checked.findings
    blocked = [f"{finding.rule_id}: {finding.message}" for finding in findings if finding.blocking]
    if not blocked and judging and verdict is None:
        blocked.append(f"judge: {checked.judge_error or 'no verdict'}; the plan is on hold")
    objected = verdict is not None and verdict.verdict == "Failure"
    accepted = tuple(warnings(findings))
    state = approval_state(read, blocked=bool(blocked), objected=objected, warned=bool(accepted))
    return ApprovalRequested(
        request_id=request_id,
        attempt=attempt,
        plan=checked.plan,
        blocked_by=tuple(blocked),
        acknowledge=accepted,
        needs_override=objected,
        asked=read.asked,
        readings=read.readings,
        if_halted=tuple(if_halted),
        gaps=read.gaps,
        confidence=read.confidence,
        read_apart=read.read_apart,
        state=state,
    )


def warnings(findings: Iterable[Finding]) -> list[str]:
    """Return the ids of the broken rules that an operator may acknowledge (Medium priority)."""
    return [finding.rule_id for finding in findings if finding.broken and not finding.blocking]


def people_needed(
    request: ApprovalRequested, approvals: Mapping[str, int], fresh: Collection[str] = ()
) -> dict[str, int]:
    """Return the acts in `request` that several people must approve, with the number of people.

    `approvals` maps acts to the number of people that the rules require; `fresh` are the agents
    that have never had an order.
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


def people_words(needed: Mapping[str, int]) -> str:
    """Return in words which acts need several people, with the number of people."""
    needs = (f"{_ACTS.get(act, act)} needs {people} people" for act, people in needed.items())
    return ", ".join(needs)


def inadmissible(
    request: ApprovalRequested,
    decision: Decision,
    needed: Mapping[str, int] | None = None,
    people: int = 1,
) -> str:
    """Return why `decision` cannot be accepted for `request`; '' if it can.

    `people` is the number of people who have approved the plan. `needed` maps each act that several
    people must approve to the number of people.
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
    lacking = {act: required for act, required in (needed or {}).items() if people < required}
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
    if request.proposed_by and decision.standing:
        return NOT_FOR_AGENTS
    if request.blocked_by:
        return f"the plan cannot be approved by anyone: {'; '.join(request.blocked_by)}"
    missing = [rule for rule in request.acknowledge if rule not in decision.acknowledged]
    if missing:
        return f"acknowledge the broken rules first: {', '.join(missing)}"
    if request.needs_override and not (decision.override_judge and decision.reason.strip()):
        return "the judge said Failure: overriding it needs a reason"
    return ""


def standing_approver(
    mode: ApprovalMode,
    override_reason: str = "",
    reading: int = 0,
    *,
    least: float | None = None,
    origin: str = "",
) -> Approver:
    """Return the approver that follows a standing instruction given before the mission.

    In evaluations, the approver first chooses the other reading with the number `reading`, if the
    request offers it; 0 keeps the first reading.

    `auto` approves every plan that may be approved, and acknowledges warnings. It overrides a
    judge's Failure only with `override_reason`, which is logged only with that decision. `never`
    rejects every plan.

    Because no person sees the plan, its reading must not be in `doubt`: the plan must be in the
    state `approve` or `warned`, with a confidence of at least `least`, 0 to 1. A `least` of None
    skips both conditions, for evaluations, which measure every plan. An order that was not
    understood is never approved.

    `origin` names the source of the instruction in the log; by default, the command line.
    """
    chosen: list[str] = []

    def decide(request: ev.ApprovalRequested) -> Decision:
        by = f"{STANDING}: {origin or f'--approve {mode}'}"
        others = request.readings[reading - 1 : reading] if reading and not chosen else ()
        for chosen_reading in others:
            chosen.append(chosen_reading)
            return Decision(kind="choose", by=by, asked=chosen_reading)
        if mode == "never":
            return Decision(kind="reject", by=by, reason="plans are never approved in this run")
        if request.blocked_by:
            return Decision(kind="reject", by=by, reason="; ".join(request.blocked_by))
        if request.standing is not None or request.proposed_by:
            why = NOT_FOR_AGENTS if request.proposed_by else NOT_BEFOREHAND
            return Decision(kind="reject", by=by, reason=why)
        if request.approvals:
            reason = f"{people_words(request.approvals)} to approve, and nobody looked at it"
            return Decision(kind="reject", by=by, reason=reason)
        if least is not None and (why := doubt(request, least)):
            return Decision(kind="reject", by=by, reason=why)
        if request.needs_override and not override_reason.strip():
            reason = "the judge said Failure and no override reason was given"
            return Decision(kind="reject", by=by, reason=reason)
        instructed = "approved by standing instruction"
        return request.approved(override_reason if request.needs_override else instructed, by)

    return decide


def doubt(request: ev.ApprovalRequested, least: float) -> str:
    """Return why the order may have been misread; '' if its reading is certain enough.

    If it may have been misread, only an operator may approve the plan.

    Two models that agree may make the same mistake, so the words of the order must also support the
    reading.
    """
    why = list(request.gaps)
    if request.read_apart:
        why.append("another reader reads the order otherwise")
    if least > 0.0 and request.confidence is None:
        why.append("not both models have told how sure they are of what was asked")
    if request.confidence is not None and request.confidence < least:
        why.append(f"read with {request.confidence:.0%} confidence, {least:.0%} are needed")
    if not why and request.state not in ("approve", "warned", "judge_objects"):
        why.append(status_of("approval", request.state or "none").word.lower())
    return f"too doubtful for a standing instruction: {'; '.join(why)}" if why else ""


def unasked_decision(
    order: StandingOrder, request: ev.ApprovalRequested, allowed: Collection[Verb]
) -> Decision | None:
    """Return the decision of a standing `order` on its mission's plan; None if it makes none.

    `allowed` are the commands that the rules permit without approval. A plan that several people
    must approve is rejected. Any other plan that the standing order may not approve waits for the
    operator.
    """
    if not order.unasked or not allowed:
        return None
    origin = f"standing order {order.id}"
    decision = standing_approver("auto", least=SURE_ENOUGH, origin=origin)(request)
    decided = decision.model_copy(update={"standing_order": order.id})
    if decision.kind == "approve":
        return None if not_unasked(order, request, allowed) else decided
    return decided if request.approvals and not request.blocked_by else None


def not_unasked(
    order: StandingOrder | None, request: ev.ApprovalRequested, allowed: Collection[Verb]
) -> str:
    """Return why a standing `order` may not approve `request` unasked; '' if it may.

    `order` is None if the order is not in force or did not start the mission.
    """
    if order is None:
        return "no standing order in force has started this mission"
    if not order.unasked:
        return f"{order.id} does not say that nobody need be asked"
    if request.standing is not None:
        return "no standing order approves another"
    actions = (*request.plan.actions, *request.if_halted)
    moving = dict.fromkeys(a.verb for a in actions if a.verb not in STILL)
    beyond = [verb for verb in moving if verb not in allowed]
    if beyond:
        return f"the rules allow no {', '.join(beyond)} without approval"
    if request.approvals:
        return f"{people_words(request.approvals)} to approve"
    by_plan = set(request.acknowledge) - set(request.broken_anyway)
    if by_plan or request.needs_override or request.state not in ("approve", "warned"):
        return "somebody has to look at this plan"
    return doubt(request, SURE_ENOUGH)
