"""Each step of a mission as one line, as it happens."""

from pa_console.schema.events import event as ev
from pa_console.views.event_words import event_in_words

_TOLD: dict[str, str] = {
    "mission_received": "mission",
    "standing_order_read": "standing order",
    "standing_order_approved": "in force",
    "standing_order_started": "started",
    "rules_retrieved": "rules found",
    "plan_proposed": "plan",
    "plan_checked": "safeguards",
    "plan_judged": "judge",
    "repair_requested": "planned again",
    "plan_voided": "plan void",
    "command_sent": "sent",
    "command_refused": "refused",
    "plan_halted": "plan halted",
    "mission_verified": "telemetry",
    "outcome_judged": "judge on the outcome",
    "mission_preempted": "waits again",
    "mission_finished": "finished",
}
"""The steps that are shown, and their names."""


def step_line(event: ev.Event) -> str:
    """Return the meaning of `event` in one line; empty if it is no step of a mission.

    Changes of a model's server, and of its replacement, are shown too.
    """
    match event.data:
        case ev.ServerChanged(state=state) if state != "probing":
            return f"model server: {event_in_words(event.data)}"
        case ev.Noticed(subject="model server", text=text):
            return f"model server: {text}"
        case _:
            pass
    name = _TOLD.get(event.data.kind)
    if name is None or event.mission is None:
        return ""
    said = event_in_words(event.data)
    return f"{event.mission}  {name}: {said}" if said else f"{event.mission}  {name}"
