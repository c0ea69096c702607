"""Why the plan that waits cannot be approved, or signed for another station, in words."""

from collections.abc import Iterable, Sequence

from pa_console.schema.events.event import ApprovalRequested, DecisionMade
from pa_console.tui.protocols import JoinedTo


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
    """Return why nothing is to be signed here for another station, empty where something is.

    `made` are the decisions of the mission so far.
    """
    if not request.approvals:
        return f"one person is enough: {joined.station} decides"
    now = [each.decision for each in made if each.attempt == request.attempt]
    signed = any(joined.signer in decision.signatures for decision in now)
    return f"you have signed; {joined.station} decides" if signed else ""
