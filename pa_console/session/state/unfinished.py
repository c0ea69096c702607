"""What a session has not finished: the missions that wait, and those that were begun."""

from pa_console.schema.alarm import QueueEntry
from pa_console.session.state.fold import SessionState
from pa_console.session.state.mission_trace import MissionTrace


def waiting_entries(state: SessionState) -> tuple[QueueEntry, ...]:
    """Return the places in the queue of the missions that have not begun, the next one first."""
    known = state.missions
    return tuple(
        entry
        for entry in state.queue
        if (trace := known.get(entry.mission.id)) is None
        or not (_begun(state, trace) or trace.status is not None)
    )


def begun_missions(state: SessionState) -> tuple[MissionTrace, ...]:
    """Return the missions that have begun and not ended, in the order of their arrival."""
    return tuple(
        trace for trace in state.missions.values() if trace.status is None and _begun(state, trace)
    )


def _begun(state: SessionState, trace: MissionTrace) -> bool:
    """Whether a mission was worked on, now or before an emergency went first."""
    return bool(trace.attempts) or trace.mission.id == state.active
