"""The open alarms and the missions that wait, in one list with one cursor."""

from textual.content import Content

from pa_console.session.fold import OpenAlarm, SessionState
from pa_console.tui.refresh import retitle
from pa_console.tui.vocabulary import QUIET
from pa_console.tui.widgets.alarm_rows import alarm_row, answering, queue_rows
from pa_console.tui.widgets.virtual_rows import VirtualRows

_ALARM, _MISSION = "alarm:", "mission:"
EMPTY = "No alarm is open and no mission waits."


class AlarmPane(VirtualRows):
    """Worst alarm first, then the queue, next mission first.

    The cursor is always shown. It is on the worst alarm that nobody has seen, unless the
    operator put it elsewhere.
    """

    def __init__(self, **kwargs: str) -> None:
        super().__init__(**kwargs)
        self._lines: list[Content] = [Content.styled(EMPTY, QUIET)]
        self._alarms: tuple[OpenAlarm, ...] = ()
        self._subjects: dict[str, str] = {}
        self._held = False
        self.border_title = "Alarms and queue"

    def show(self, state: SessionState) -> None:
        """Show the session's alarms and queue."""
        self._alarms = state.alarms
        answers, active = answering(state), state.active or ""
        keys: list[str] = []
        self._lines, self._subjects = [], {}
        for item in state.alarms:
            key = f"{_ALARM}{item.alarm.id}"
            keys.append(key)
            self._lines.append(alarm_row(item, answers, active))
            self._subjects[key] = item.alarm.subject
        for place, entry in enumerate(state.queue, start=1):
            key = f"{_MISSION}{entry.mission.id}"
            keys += [key, key]
            self._lines += queue_rows(place, entry)
            self._subjects[key] = entry.mission.subject or entry.mission.gate or ""
        if not keys:
            keys, self._lines = [""], [Content.styled(EMPTY, QUIET)]
        if not self._held or self.cursor not in keys:
            self._held = False
            new_ones = (item.alarm.id for item in state.alarms if not item.acknowledged)
            first = next(new_ones, None)
            self.cursor = keys[0] if first is None else f"{_ALARM}{first}"
        new = sum(not item.acknowledged for item in state.alarms)
        title = f"Alarms {len(state.alarms)}" + (f", {new} new" if new else "")
        retitle(self, f"{title}   Queue {len(state.queue)}")
        self.set_keys(keys)

    def row(self, index: int, width: int) -> Content:
        """Return a line of the list, with a pointer on the one that keys are about."""
        here = bool(self.cursor) and self.keys[index] == self.cursor
        pointer = ("▸ ", "bold $text-accent") if here else "  "
        return Content.assemble(pointer, self._lines[index]).truncate(width, ellipsis=True)

    @property
    def subject(self) -> str:
        """The track, asset, gate or camera that the row under the cursor is about."""
        return self._subjects.get(self.cursor, "")

    @property
    def alarm(self) -> OpenAlarm | None:
        """The alarm under the cursor, else the worst that nobody has seen."""
        if not self.region.area:
            return next((item for item in self._alarms if not item.acknowledged), None)
        chosen = next((a for a in self._alarms if self.cursor == f"{_ALARM}{a.alarm.id}"), None)
        if chosen is not None and not chosen.acknowledged:
            return chosen
        return next((item for item in self._alarms if not item.acknowledged), None)

    @property
    def mission(self) -> str:
        """The id of the waiting mission under the cursor, empty when it is not on one."""
        return self.cursor.removeprefix(_MISSION) if self.cursor.startswith(_MISSION) else ""

    def point_at(self, key: str) -> None:
        """Hold the cursor on `key`, whatever comes, until its row is gone or released."""
        self._held = True
        super().point_at(key)

    def release(self) -> None:
        """Let the cursor go back to the worst alarm that nobody has seen."""
        self._held = False

    def next_alarm(self) -> None:
        """Put the cursor on the next alarm, going round."""
        self._go_round(_ALARM)

    def next_mission(self) -> None:
        """Put the cursor on the next waiting mission, going round."""
        self._go_round(_MISSION)

    def _go_round(self, prefix: str) -> None:
        keys = [key for key in self._subjects if key.startswith(prefix)]
        if keys:
            at = keys.index(self.cursor) + 1 if self.cursor in keys else 0
            self.point_at(keys[at % len(keys)])
