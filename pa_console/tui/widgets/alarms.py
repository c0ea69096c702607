"""The open alarms and the waiting missions: a summary in one line, and a list with a cursor."""

from collections.abc import Iterator, Mapping, Sequence

from textual import events
from textual.content import Content
from textual.widgets import Static

from pa_console.schema.mission import QueueEntry
from pa_console.schema.text import clock_text, visible
from pa_console.session.mission_trace import MissionTrace
from pa_console.session.state import SessionState
from pa_console.session.state_parts import OpenAlarm, Stop
from pa_console.tui.refresh import retitle
from pa_console.tui.rows import column
from pa_console.tui.status_words import BAD, CALM, NOTE, QUIET, WARN, term
from pa_console.tui.widgets.row_views import VirtualRows

_FILL = {
    BAD: "$on-error on $error",
    WARN: "$on-warning on $warning",
    CALM: "$on-primary on $primary",
    QUIET: "$on-quiet on $quiet",
}
"""The background of a sign that must not be overlooked, by the colour of the sign."""

Part = Content | tuple[str, str] | str

_ALARM, _MISSION = "alarm:", "mission:"
EMPTY = "No open alarms and no waiting missions."


def alarm_row(item: OpenAlarm, answers: Mapping[str, MissionTrace], active: str) -> Content:
    """Return the row of an alarm: priority, whether it was seen, text, mission and time."""
    alarm = item.alarm
    mark = term("alarm", alarm.priority)
    seen = term("seen", "seen" if item.acknowledged else "new")
    answer = answers.get(alarm.id)
    mission: tuple[str, str] = ("", "")
    if answer is not None and answer.status is None:
        doing = "works on it" if answer.mission.id == active else "waits"
        mission = (f"  {answer.mission.id} {doing}", QUIET)
    distance = f" ({alarm.distance_m:.0f} m)" if alarm.distance_m is not None else ""
    return Content.assemble(
        column(f"{mark.glyph} {mark.word}", 11, f"bold {mark.style}"),
        column(f"{seen.glyph} {seen.word}", 6, seen.style),
        (visible(alarm.text), "" if item.acknowledged else "bold"),
        distance,
        mission,
        (f"  since {clock_text(alarm.raised_s)}", QUIET),
    )


def queue_rows(place: int, entry: QueueEntry) -> tuple[Content, Content]:
    """Return a waiting mission as two lines: the mission, and the reason for its position."""
    mark = term("alarm", entry.priority)
    mission = entry.mission
    origin = ("by alarm  ", NOTE) if mission.source == "alarm" else ("", "")
    if mission.standing:
        origin = (f"by {mission.standing}  ", NOTE)
    if mission.agent:
        origin = (f"by agent {mission.agent}  ", WARN)
    later = ("deferred  ", WARN) if entry.deferred else ("", "")
    head = Content.assemble(
        column(f"{place}.", 3, "bold"),
        (f"{mission.id} ", "bold $text-accent"),
        (f"{mark.glyph} {mark.word}  ", mark.style),
        origin,
        later,
        visible(mission.said),
    )
    distance = f"{entry.distance_m:.0f} m, " if entry.distance_m is not None else ""
    return head, Content.assemble("    ", (f"{distance}{entry.reason}", QUIET))


def answering(state: SessionState) -> dict[str, MissionTrace]:
    """Return the unfinished mission that answers each open alarm."""
    answered = [alarm for alarm in state.open_alarms if alarm in state.answers]
    return {alarm: state.missions[state.answers[alarm]] for alarm in answered}


def summary(state: SessionState, width: int) -> Content:
    """Return one line: a stop, the alarms and the worst of them, the queue, weather, scenario.

    If room is short, the scenario is left out first, then the next mission in the queue, then the
    end of the alarm's text, then the weather. A stop, the number of alarms and the priority of the
    worst one are always kept.
    """
    head = Content.assemble(*_stop(state.stop), *_alarms(state.alarms))
    worst = _worst(state.alarms)
    line = Content.assemble(head, visible(worst.alarm.text)) if worst else head
    queue, weather = state.queue, [*_weather(state)]
    ways = (
        [*_queue(queue), *weather, *_scenario(state)],
        [*_queue(queue), *weather],
        [*_queue(queue, names_next=False), *weather],
    )
    ends = next((ends for ends in ways if line.cell_length + _length(ends) <= width), ways[-1])
    while ends and _length(ends) > width - head.cell_length:
        ends.pop()
    line = line.truncate(max(width - _length(ends), 1), ellipsis=True)
    return Content.assemble(line, *(part for end in ends for part in ("  ", end)))


def _length(parts: Sequence[Content]) -> int:
    return sum(part.cell_length + 2 for part in parts)


def _alarms(alarms: Sequence[OpenAlarm]) -> Iterator[Part]:
    worst = _worst(alarms)
    if worst is None:
        yield term("alarm", "none").part
        return
    fresh = sum(not item.acknowledged for item in alarms)
    mark = term("alarm", worst.alarm.priority)
    plural = "s" if len(alarms) > 1 else ""
    new = f", {fresh} NEW" if fresh else ""
    style = f"bold {mark.style}"
    tag = f" {mark.glyph} {len(alarms)} alarm{plural}{new} "
    yield (tag, f"bold {_FILL[mark.style]}" if fresh else style)
    yield (f" {mark.word} ", style)


def _worst(alarms: Sequence[OpenAlarm]) -> OpenAlarm | None:
    """Return the worst unseen alarm, or else the worst alarm."""
    fresh = (item for item in alarms if not item.acknowledged)
    return next(fresh, alarms[0] if alarms else None)


def _stop(stop: Stop | None) -> Iterator[Part]:
    """Yield the stop until it is released, and whether the assets have confirmed it."""
    if stop is None:
        return
    held = f"  {stop.held} hold" if stop.orders else ""
    yield (" ■ ALL STOPPED ", f"bold {_FILL[BAD]}")
    yield (held, "bold")
    if stop.overdue:
        first, *others = stop.overdue
        more = f" and {len(others)} more" if others else ""
        yield "  "
        yield (f" STOP not confirmed by {first}{more} ", f"bold {_FILL[BAD]}")
    elif stop.unconfirmed:
        yield (f", {len(stop.unconfirmed)} not confirmed", f"bold {WARN}")
    yield "  "


def _queue(queue: Sequence[QueueEntry], *, names_next: bool = True) -> Iterator[Content]:
    if queue:
        following = f", next {queue[0].mission.id}" if names_next else ""
        yield Content.styled(f"queue {len(queue)}{following}", NOTE)


def _weather(state: SessionState) -> Iterator[Content]:
    if state.picture is not None:
        yield term("weather", state.picture.weather).content


def _scenario(state: SessionState) -> Iterator[Content]:
    if state.scenario:
        yield Content.styled(f"scenario {state.scenario}", QUIET)


class AlarmBar(Static):
    """A permanent line with the number of alarms and the most serious one, or *no alarm*."""

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


class AlarmPane(VirtualRows):
    """The alarms, the worst first, and then the queue, the next mission first.

    The cursor is always shown. It is on the worst unseen alarm unless the operator moves it.
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
        """Return a line of the list; the line that keys act on has a pointer."""
        here = bool(self.cursor) and self.keys[index] == self.cursor
        pointer = ("▸ ", "bold $text-accent") if here else "  "
        return Content.assemble(pointer, self._lines[index]).truncate(width, ellipsis=True)

    @property
    def subject(self) -> str:
        """The track, asset, gate or camera of the row under the cursor."""
        return self._subjects.get(self.cursor, "")

    @property
    def alarm(self) -> OpenAlarm | None:
        """The unseen alarm under the cursor, or else the worst unseen one."""
        if not self.region.area:
            return next((item for item in self._alarms if not item.acknowledged), None)
        chosen = next((a for a in self._alarms if self.cursor == f"{_ALARM}{a.alarm.id}"), None)
        if chosen is not None and not chosen.acknowledged:
            return chosen
        return next((item for item in self._alarms if not item.acknowledged), None)

    @property
    def mission(self) -> str:
        """The id of the waiting mission under the cursor; empty if there is none."""
        return self.cursor.removeprefix(_MISSION) if self.cursor.startswith(_MISSION) else ""

    def point_at(self, key: str) -> None:
        """Keep the cursor on `key` until its row is gone or the cursor is released."""
        self._held = True
        super().point_at(key)

    def release(self) -> None:
        """Move the cursor back to the worst unseen alarm."""
        self._held = False

    def next_alarm(self) -> None:
        """Move the cursor to the next alarm, after the last one to the first."""
        self._go_round(_ALARM)

    def next_mission(self) -> None:
        """Move the cursor to the next waiting mission, after the last one to the first."""
        self._go_round(_MISSION)

    def _go_round(self, prefix: str) -> None:
        keys = [key for key in self._subjects if key.startswith(prefix)]
        if keys:
            at = keys.index(self.cursor) + 1 if self.cursor in keys else 0
            self.point_at(keys[at % len(keys)])
