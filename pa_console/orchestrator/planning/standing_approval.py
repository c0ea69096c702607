"""Approvals that are given beforehand: by an instruction at the start, or by a standing order.

Nobody looks at such a plan. So the gate, the rules and the models have to be surer than where
somebody does.
"""

from collections.abc import Callable, Collection
from typing import Literal

from pa_console.orchestrator.planning.approval import NOT_BEFOREHAND, people_words
from pa_console.schema.command import Verb
from pa_console.schema.events import event as ev
from pa_console.schema.mission import STANDING, Decision
from pa_console.schema.standing import StandingOrder
from pa_console.views.status_words import status_of

Approver = Callable[[ev.ApprovalRequested], Decision]
ApprovalMode = Literal["auto", "never"]

SURE_ENOUGH = 0.9
"""The lowest confidence in a reading at which a standing order approves a plan."""
_STILL = frozenset(("hold", "report"))


def standing_approver(
    mode: ApprovalMode,
    override_reason: str = "",
    reading: int = 0,
    *,
    least: float | None = None,
    given: str = "",
) -> Approver:
    """Return the approver that follows a standing instruction given before the mission.

    Where other readings of the order are offered, it first chooses the one of that number, if
    there are so many (evaluations only); 0 takes the order as it was read.

    `auto` approves what may be approved and acknowledges warnings; a judge's Failure is only
    overridden with `override_reason`, which stands with such a decision alone. `never` rejects
    every plan.

    Nobody watches a standing approval, so it takes a plan in the state `approve` alone, and none
    for an order that may have been misread (`doubt`): the console has to be at least so sure, 0 to
    1, as `least` says. None takes it all the same, for evaluations, where the truth of every plan
    is wanted; what was not understood is taken by nobody.

    The log names the instruction as it was `given`, by default as the command line's.
    """
    chosen: list[str] = []

    def decide(request: ev.ApprovalRequested) -> Decision:
        by = f"{STANDING}: {given or f'--approve {mode}'}"
        others = request.readings[reading - 1 : reading] if reading and not chosen else ()
        for asked in others:
            chosen.append(asked)
            return Decision(kind="choose", by=by, asked=asked)
        if mode == "never":
            return Decision(kind="reject", by=by, reason="plans are never approved in this run")
        if request.blocked_by:
            return Decision(kind="reject", by=by, reason="; ".join(request.blocked_by))
        if request.standing is not None:
            return Decision(kind="reject", by=by, reason=NOT_BEFOREHAND)
        if request.approvals:
            reason = f"{people_words(request.approvals)} to approve, and nobody looked at it"
            return Decision(kind="reject", by=by, reason=reason)
        if least is not None and (why := doubt(request, least)):
            return Decision(kind="reject", by=by, reason=why)
        if request.needs_override and not override_reason.strip():
            reason = "the judge said Failure and no override reason was given"
            return Decision(kind="reject", by=by, reason=reason)
        return Decision(
            kind="approve",
            by=by,
            reason=override_reason
            if request.needs_override
            else "approved by standing instruction",
            override_judge=request.needs_override,
            acknowledged=request.acknowledge,
        )

    return decide


def doubt(request: ev.ApprovalRequested, least: float) -> str:
    """Return why the order may have been misread, so that only an operator may approve; or ''.

    Two models that agree may be wrong alike: the order's own words have to bear them out.
    """
    why = list(request.gaps)
    if request.read_apart:
        why.append("another reader reads the order otherwise")
    if least > 0.0 and request.confidence is None:
        why.append("not both models have told how sure they are of what was asked")
    if request.confidence is not None and request.confidence < least:
        why.append(f"read with {request.confidence:.0%} confidence, {least:.0%} are needed")
    if not why and request.state not in ("approve", "judge_objects"):
        why.append(status_of("approval", request.state or "none").word.lower())
    return f"too doubtful for standing approval: {'; '.join(why)}" if why else ""


def unasked_decision(
    order: StandingOrder, request: ev.ApprovalRequested, allowed: Collection[Verb]
) -> Decision | None:
    """Return the decision of a standing `order` on its own plan, None if it decides nothing.

    The rules name the commands that are `allowed`. A plan that more than one person must approve is
    rejected; one that it may not approve otherwise waits for the operator.
    """
    if not order.unasked or not allowed:
        return None
    given = f"standing order {order.id}"
    decision = standing_approver("auto", least=SURE_ENOUGH, given=given)(request)
    decided = decision.model_copy(update={"standing_order": order.id})
    if decision.kind == "approve":
        return None if not_unasked(order, request, allowed) else decided
    return decided if request.approvals and not request.blocked_by else None


def not_unasked(
    order: StandingOrder | None, request: ev.ApprovalRequested, allowed: Collection[Verb]
) -> str:
    """Return why a standing `order` may not approve `request` unasked, '' when it may.

    None is an order that is not in force, or did not start the mission.
    """
    if order is None:
        return "no standing order in force has started this mission"
    if not order.unasked:
        return f"{order.id} does not say that nobody need be asked"
    if request.standing is not None:
        return "no standing order approves another"
    actions = (*request.plan.actions, *request.if_halted)
    moving = dict.fromkeys(a.verb for a in actions if a.verb not in _STILL)
    beyond = [verb for verb in moving if verb not in allowed]
    if beyond:
        return f"the rules allow no {', '.join(beyond)} without approval"
    if request.approvals:
        return f"{people_words(request.approvals)} to approve"
    if request.acknowledge or request.needs_override or request.state != "approve":
        return "somebody has to look at this plan"
    return doubt(request, SURE_ENOUGH)
