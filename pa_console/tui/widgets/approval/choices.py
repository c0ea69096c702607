"""The choices of the approval panel's buttons, by name, and their decisions."""

from collections.abc import Sequence

from pa_console.schema.events.event import ApprovalRequested
from pa_console.schema.mission import Decision
from pa_console.session.mission_trace import MissionTrace

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
