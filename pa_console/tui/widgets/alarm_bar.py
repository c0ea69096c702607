"""The second line of every session's screen: stop, alarms, queue, weather and scenario."""

from textual import events
from textual.widgets import Static

from pa_console.session.fold import SessionState
from pa_console.tui.widgets.alarm_rows import summary


class AlarmBar(Static):
    """Always there: the number of alarms with the worst of them, or that there is none."""

    def __init__(self, **kwargs: str) -> None:
        super().__init__(id=kwargs.get("id"), markup=False)
        self._state: SessionState | None = None

    def show(self, state: SessionState) -> None:
        """Show the session; a stop colours the whole line until it is released."""
        self._state = state
        self.set_class(state.stop is not None, "-stopped")
        self.update(summary(state, max(self.content_size.width, 20)), layout=False)

    def on_resize(self, _event: events.Resize) -> None:
        """Fit the line to the new width."""
        if self._state is not None:
            self.show(self._state)
