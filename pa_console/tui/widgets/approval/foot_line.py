"""The foot of the approval panel: the reason against Approve, or the effect of the next key."""

from collections.abc import Iterable, Sequence
from typing import Literal

from pa_console.schema.events.event import ApprovalRequested, DecisionMade
from pa_console.tui.protocols import JoinedTo

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
