"""Calls the operator when something begins to wait: bell, desktop notice, window title."""

from collections.abc import Callable

from pa_console.session.state import SessionState
from pa_console.tui.attention_codes import KEEP_TITLE, RESTORE_TITLE, notice, window_title
from pa_console.tui.controllers.console_session import ConsoleSession
from pa_console.tui.controllers.settings import SettingsController

_URGENT = ("emergency", "high")


class AttentionController:
    """Looks at the session after each frame; every means can be switched off in the settings."""

    def __init__(
        self,
        session: ConsoleSession,
        settings: SettingsController,
        write: Callable[[str], object] | None,
    ) -> None:
        """`write` sends codes to the terminal; None where there is none."""
        self._session, self._settings, self._write = session, settings, write
        self._waits: frozenset[str] = frozenset()
        self._title: str | None = None

    def look(self) -> None:
        """Notify of plans that have begun to wait since the last look."""
        session, write = self._session, self._write
        if write is None or session.player is not None or not session.decides:
            return
        now = what_waits(session.folded)
        new = [text for key, text in now.items() if key not in self._waits]
        self._waits = frozenset(now)
        values = self._settings.loaded.values
        if new and values.bell:
            write("\a")
        if new and values.desktop_notices:
            write(notice("; ".join(new)))
        self._name_window(write, next(iter(now.values()), ""), wanted=values.window_title)

    def leave(self) -> None:
        """Give the window its own title back."""
        if self._write is not None and self._title is not None:
            self._write(RESTORE_TITLE)
            self._title = None

    def _name_window(self, write: Callable[[str], object], title: str, *, wanted: bool) -> None:
        if not wanted:
            self.leave()
        elif title != self._title:
            first = KEEP_TITLE if self._title is None else ""
            self._title = title
            write(first + window_title(title))


def what_waits(state: SessionState) -> dict[str, str]:
    """Return what waits for the operator, in words by a key of its own, the first most urgent."""
    waits: dict[str, str] = {}
    if state.log_problem:
        waits["log"] = "the session log cannot be written"
    current = state.current
    if current is not None and current.approval is not None:
        request = current.approval.request_id or str(current.approval.attempt)
        waits[f"approval {current.mission.id} {request}"] = f"plan of {current.mission.id} waits"
    for item in state.alarms:
        if not item.acknowledged and item.alarm.priority in _URGENT:
            key = f"alarm {item.alarm.id} {item.alarm.priority}"
            waits[key] = f"{item.alarm.priority} alarm: {item.alarm.subject}"
    return waits
