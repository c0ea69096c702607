"""The choices of the approval panel: each button's decision, and the reason against Approve."""

from collections.abc import Iterable, Sequence
from typing import Literal

from pa_console.schema.events.event import ApprovalRequested, DecisionMade
from pa_console.schema.mission import Decision
from pa_console.session.mission_trace import MissionTrace
from pa_console.tui.protocols import JoinedTo

_MEANT = "meant-"


def name_of_meaning(number: int) -> str:
    """Return the name of the button for what the order may mean, numbered from 1."""
    return f"{_MEANT}{number}"


def reading_of(trace: MissionTrace | None, name: str) -> str:
    """Return the reading that a button of this name chooses, '' for none."""
    request = trace.approval if trace is not None else None
    return _named(request.readings if request is not None else (), name)


def answer_of(trace: MissionTrace | None, name: str) -> str:
    """Return the answer that a button of this name chooses, '' where nothing is asked back."""
    return _named(trace.choices if trace is not None else (), name)


def _named(meanings: Sequence[str], name: str) -> str:
    number = name.removeprefix(_MEANT)
    if not name.startswith(_MEANT) or not number.isdigit():
        return ""
    return next(iter(meanings[int(number) - 1 : int(number)]), "")


def may_modify(request: ApprovalRequested) -> bool:
    """Return whether there is a plan that the operator may change."""
    return request.standing is None and request.state != "not_understood"


def decision_of(trace: MissionTrace, choice: str, reason: str) -> Decision | None:
    """Return the decision that a button makes of the request that waits; None for none.

    An approval accepts and overrides what the request asks for: whether that was given is for the
    panel to see to.
    """
    request = trace.approval
    if request is None:
        return None
    if answer := answer_of(trace, choice):
        return answering(request, answer)
    if asked := reading_of(trace, choice):
        return Decision(kind="choose", request_id=request.request_id, asked=asked)
    if choice == "reject":
        return Decision(kind="reject", request_id=request.request_id, reason=reason)
    if choice == "approve":
        return Decision(
            kind="approve",
            request_id=request.request_id,
            reason=reason,
            override_judge=request.needs_override,
            acknowledged=request.acknowledge,
        )
    return None


def answering(request: ApprovalRequested, answer: str) -> Decision | None:
    """Return the answer to a question about the order; None if a plan waits."""
    if request.state != "not_understood":
        return None
    return Decision(kind="answer", request_id=request.request_id, asked=answer)


FocusAt = Literal["panel", "reading", "approve", "within", "elsewhere"]
"""The focus: the panel itself, a reading that is shown, Approve, another of its fields."""


def next_key(focus: FocusAt, *, joined: bool, plays: bool) -> str:
    """Return what the next key does, '' where that is plain to see.

    `joined` says that a plan is signed here for another station, `plays` that there is a rehearsal
    to be played.
    """
    match focus:
        case "panel":
            return "a goes to Countersign" if joined else "r, m or a goes to a button"
        case "reading":
            return "Enter reads the order so, Esc goes back to the plan"
        case "approve":
            return "Enter signs it" if joined else "Enter approves, r goes back to Reject"
        case "within":
            return "Space plays it, Alt+C compares plans" if plays else ""
        case "elsewhere":
            return ""


def blocked_reason(request: ApprovalRequested, left: Sequence[str], reason: str) -> str:
    """Return in words why Approve is disabled, empty when it is not."""
    if request.state == "not_understood":
        return "✘ Approve: not understood, nothing is proposed"
    if request.blocked_by:
        return "✘ Approve: blocked, nobody may override"
    if left:
        return f"✘ Approve: tick {', '.join(left)} first"
    if request.needs_override and not reason.strip():
        return "✘ Approve: give a reason to override"
    return ""


def not_to_sign(joined: JoinedTo, request: ApprovalRequested, made: Iterable[DecisionMade]) -> str:
    """Return why there is nothing to sign for another station, empty if there is.

    `made` are the decisions of the mission so far.
    """
    if not request.approvals:
        return f"one person is enough: {joined.station} decides"
    now = [each.decision for each in made if each.attempt == request.attempt]
    signed = any(joined.signer in decision.signatures for decision in now)
    return f"you have signed; {joined.station} decides" if signed else ""
