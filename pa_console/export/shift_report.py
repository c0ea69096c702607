"""A whole session as a Markdown document: the shift report, followed by every mission's trace."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime

from pa_console.export.markdown import inline, mission_document, table
from pa_console.export.source_log import OpenedSession
from pa_console.schema.base import ALARM_PRIORITIES
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Alarm
from pa_console.schema.rule import Rule
from pa_console.schema.text import clock_text, count
from pa_console.session.state import SessionState
from pa_console.session.wording import command_taken_in_words, deviations_in_words
from pa_console.views.status_words import outcomes_in_words

Row = Sequence[object]


@dataclass
class _AlarmRow:
    """An alarm at its highest priority, with the times of its acknowledgement and end."""

    at: str
    alarm: Alarm
    seen: str = ""
    over: str = ""


@dataclass
class _Shift:
    """The entries of a shift report with their times."""

    alarms: list[_AlarmRow] = field(default_factory=list[_AlarmRow])
    decisions: list[Row] = field(default_factory=list[Row])
    interventions: list[Row] = field(default_factory=list[Row])
    given: dict[str, str] = field(default_factory=dict[str, str])
    ended: dict[str, tuple[str, str]] = field(default_factory=dict[str, tuple[str, str]])
    open: dict[str, _AlarmRow] = field(default_factory=dict[str, _AlarmRow])

    def end_of(self, mission: str) -> tuple[str, str]:
        """Return the time and status with which a mission ended (or `open`), and the reason."""
        return self.ended.get(mission, ("open", ""))

    def take(self, event: ev.Event) -> None:
        """Process one event."""
        at = _clock(event.t)
        match event.data:
            case ev.AlarmRaised(alarm=alarm) if alarm.id in self.open:
                self.open[alarm.id].alarm = alarm
            case ev.AlarmRaised(alarm=alarm):
                self.open[alarm.id] = _AlarmRow(at, alarm)
                self.alarms.append(self.open[alarm.id])
            case ev.AlarmAcknowledged(alarm_id=name, by=by) if name in self.open:
                self.open[name].seen = f"{at} {by}"
            case ev.AlarmCleared(alarm_id=name, reason=reason) if name in self.open:
                self.open.pop(name).over = f"{at} {reason}"
            case ev.MissionReceived(mission=mission):
                self.given[mission.id] = at
            case ev.MissionFinished(status=status, reason=reason) if event.mission:
                self.ended[event.mission] = f"{at} {status}", reason
            case ev.DecisionMade(accepted=True, decision=decision):
                reason_words = deviations_in_words(decision) or decision.reason
                self.decisions.append((at, event.mission, decision.kind, decision.by, reason_words))
            case ev.AllStopped(by=by):
                self.interventions.append((at, "stop of all assets", by))
            case ev.StopReleased(by=by):
                self.interventions.append((at, "stop released", by))
            case ev.ManualControlTaken(asset=asset, by=by):
                self.interventions.append((at, f"{asset} taken under manual control", by))
            case ev.ManualControlEnded(asset=asset, by=by):
                self.interventions.append((at, f"{asset} given back", by))
            case ev.CommandTaken():
                self.interventions.append((at, command_taken_in_words(event.data), ""))
            case _:
                pass


def session_document(
    session: OpenedSession,
    rules: Mapping[str, Rule],
    notes: tuple[str, ...] = (),
    stills: str = "",
) -> str:
    """Return the document of a session; `notes` are remarks on the log or the rules.

    `stills` is the path from the document to the folder with the camera stills; '' shows none.
    """
    recording, state = session.recording, session.final_state()
    shift = _Shift()
    for index in recording.timeline.without_telemetry(0, len(recording)):
        shift.take(recording[index])
    first = recording[0].t
    parts = [
        f"# Shift report {inline(session.started.session)}",
        *(f"**Note:** {inline(note)}" for note in notes),
        _summary(session, state, shift, first),
        *_part("Left open", "what|which", _left_open(state)),
        *_part("Missions", "mission|given|from|order|ended|reason", _missions(state, shift)),
        *_part("Decisions", "at|mission|decision|by|reason", shift.decisions),
        *_part("Alarms", "at|priority|alarm|seen|over", _alarms(shift)),
        *_part("Standing orders", "order|text|approved by|missions|ended", _standing(state)),
        *_part("Stops and manual control", "at|what|by", shift.interventions),
    ]
    traces = (
        mission_document(trace, session.started, rules, stills=stills)
        for trace in state.missions.values()
    )
    return "\n\n".join([*parts, *traces]).rstrip("\n") + "\n"


def _part(title: str, heads: str, rows: Sequence[Row]) -> Iterator[str]:
    yield f"## {title}"
    yield table(heads.split("|"), rows) if rows else "None."


def _summary(session: OpenedSession, state: SessionState, shift: _Shift, first: datetime) -> str:
    started, duration = session.started, session.recording.timeline.duration
    last = session.recording[len(session.recording) - 1].t
    ends = Counter(trace.status or "open" for trace in state.missions.values())
    raised = Counter(row.alarm.priority for row in shift.alarms)
    priorities = [f"{raised[name]} {name}" for name in ALARM_PRIORITIES if raised[name]]
    by = Counter(str(row[3]) for row in shift.decisions)
    rows = [
        ("from", f"{first.astimezone():%Y-%m-%d %H:%M:%S %Z}"),
        ("to", f"{last.astimezone():%Y-%m-%d %H:%M:%S}, {clock_text(duration)} later"),
        ("ended", state.ended or "no, not closed"),
        ("missions", f"{len(state.missions)}: {outcomes_in_words(ends)}"),
        ("decisions", ", ".join(f"{number} by {name}" for name, number in by.items()) or "none"),
        ("alarms", ", ".join(priorities) or "none"),
        ("world and rules", f"{started.world}, {started.rules} {started.rules_sha256[:12]}"),
        ("scenario", started.scenario),
    ]
    return table(("what", "value"), [row for row in rows if row[1]])


def _left_open(state: SessionState) -> list[Row]:
    """Return the open items that the next shift has to know about."""
    picture = state.picture
    gates = picture.gates if picture is not None else {}
    assets = picture.assets.values() if picture is not None else ()
    rows: list[Row] = [("gate not covered", name) for name, one in gates.items() if not one.covered]
    rows += [("asset failed", one.id) for one in assets if one.status == "failed"]
    rows += [
        ("battery low", f"{one.id}, {one.battery_pct:.0f} %") for one in assets if one.low_battery
    ]
    rows += [("alarm", f"{item.alarm.priority}: {item.alarm.text}") for item in state.alarms]
    rows += [
        ("mission", f"{trace.mission.id} {trace.mission.said}")
        for trace in state.missions.values()
        if trace.status is None
    ]
    rows += [("manual control", f"{name}, by {one.by}") for name, one in state.manual.items()]
    rows += [("stop", f"not released, by {state.stop.by}")] if state.stop is not None else []
    return rows


def _missions(state: SessionState, shift: _Shift) -> list[Row]:
    return [
        (name, shift.given.get(name), trace.mission.source, trace.mission.said, *shift.end_of(name))
        for name, trace in state.missions.items()
    ]


def _alarms(shift: _Shift) -> list[Row]:
    return [
        (row.at, row.alarm.priority, row.alarm.text, row.seen, row.over) for row in shift.alarms
    ]


def _standing(state: SessionState) -> list[Row]:
    return [
        (name, trace.order.text, trace.by, count(trace.started, "mission"), trace.ended)
        for name, trace in state.standing.items()
    ]


def _clock(t: datetime) -> str:
    return f"{t.astimezone():%H:%M:%S}"
