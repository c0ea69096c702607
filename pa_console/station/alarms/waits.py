"""The items of a session that wait for the operator, with their urgency."""

from dataclasses import dataclass

from pa_console.schema.base import AlarmPriority
from pa_console.session.state import SessionState
from pa_console.session.state_parts import OpenAlarm

URGENT: tuple[AlarmPriority, ...] = ("emergency", "high")
"""The priorities of alarms that call the operator to the screen."""


@dataclass(frozen=True)
class Wait:
    """An item that waits, in few words; `priority` is None for a plan."""

    text: str
    priority: AlarmPriority | None = None
    detail: str = ""


def what_waits(
    state: SessionState, priorities: tuple[AlarmPriority, ...] = URGENT
) -> dict[str, Wait]:
    """Return the items that wait for the operator, each under a unique key, the most urgent first.

    Alarms with one of the `priorities` wait until they are acknowledged.
    """
    waits: dict[str, Wait] = {}
    if state.log_problem:
        waits["log"] = Wait("the session log cannot be written", "emergency", state.log_problem)
    current = state.current
    if current is not None and current.approval is not None:
        request = current.approval.request_id or str(current.approval.attempt)
        name = current.mission.id
        waits[f"approval {name} {request}"] = Wait(
            f"plan of {name} waits", None, current.mission.said
        )
    for item in state.alarms:
        if not item.acknowledged and item.alarm.priority in priorities:
            alarm = item.alarm
            words = f"{alarm.priority} alarm: {alarm.subject}"
            waits[f"alarm {alarm.id} {alarm.priority}"] = Wait(words, alarm.priority, alarm.text)
    return waits


def is_answered(state: SessionState, item: OpenAlarm) -> bool:
    """Return True if a plan that answers the alarm was approved and has not ended."""
    trace = state.missions.get(state.answers.get(item.alarm.id, ""))
    return trace is not None and trace.decision is not None and trace.decision.kind == "approve"
