"""The record that questions are answered from: the session so far, with its last missions."""

from pa_console.schema.events import event as ev
from pa_console.session.state.fold import SessionState

MOST_REMEMBERED = 50
"""The number of missions kept; a question is about the last one."""


class RecentRecord:
    """Folds the events of a session as its log has them, and forgets missions of long ago."""

    def __init__(self, state: SessionState) -> None:
        """Go on from `state`, which is the record's own from then on."""
        self.state = state

    def take(self, event: ev.Event) -> None:
        """Take in one event; what no log tells, or nobody has verified, is no part of it."""
        if event.data.transient or isinstance(event.data, ev.UNVERIFIED):
            return
        self.state.apply(event)
        if isinstance(event.data, ev.MissionReceived):
            self._forget()

    def _forget(self) -> None:
        missions = self.state.missions
        over = [name for name, trace in missions.items() if trace.status is not None]
        kept = (self.state.active, self.state.last_active)
        for name in over[: max(len(missions) - MOST_REMEMBERED, 0)]:
            if name not in kept:
                del missions[name]
