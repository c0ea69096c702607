"""The state of a session in lines: no columns to be searched, one fact a line."""

from pa_console.schema.text import clock_text, count
from pa_console.session.state import SessionState
from pa_console.views.event_words import standing_in_words
from pa_console.views.trace.layout import progress


def status_lines(state: SessionState) -> list[str]:
    """Return time, gates, stop, model, the active mission and what waits."""
    picture, lines = state.picture, list[str]()
    if picture is not None:
        lines.append(f"time {clock_text(picture.time_s)}, weather {picture.weather}")
        uncovered = [name for name, cover in picture.gates.items() if not cover.covered]
        lines.append(
            f"gates not covered: {', '.join(uncovered)}" if uncovered else "all gates covered"
        )
    if state.stop is not None:
        held, open_ = state.stop.held, state.stop.unconfirmed
        named = [
            f"{name} ({why})" if (why := state.stop.overdue.get(name)) else name for name in open_
        ]
        waits = f"; not confirmed by {', '.join(named)}" if named else ""
        lines.append(f"STOPPED: {held} assets hold{waits}; release ends the stop")
    if state.log_problem:
        lines.append(f"the log cannot be written, nothing is dispatched: {state.log_problem}")
    if state.relieved:
        lines.append(f"NOT IN COMMAND, nothing is sent: {state.relieved}")
    if state.worker is not None:
        lines.append(f"model {state.worker.state} {state.worker.detail}".strip())
    for server in state.servers.values():
        lines.append(f"model server {server.server} {server.state}: {server.detail}")
    if (tak := state.tak.connection) is not None:
        reported = count(len(state.reported_contacts), "contact")
        lines.append(f"TAK {tak.state}: {tak.detail}; {reported} reported, none verified")
    trace = state.current
    if trace is None:
        lines.append("no mission yet")
    else:
        how = "".join(span.text for span in progress(trace))
        lines.append(f"mission {trace.mission.id}: {trace.mission.said}")
        lines.append(f"  {how}")
    lines.append(f"{len(state.queue)} missions wait, {len(state.alarms)} alarms are open")
    return lines


def asset_lines(state: SessionState) -> list[str]:
    """Return a line for each asset: where it is, what it does, how it is."""
    if state.picture is None:
        return ["nothing was reported yet"]
    return [
        f"{asset.id}: {asset.task} {f'at {asset.at}' if asset.at else f'to {asset.post}'}, "
        f"{asset.status}, battery {asset.battery_pct:.0f} %, link {asset.comms}"
        f"{', report is old' if asset.stale else ''}"
        for asset in state.picture.assets.values()
    ]


def alarm_lines(state: SessionState) -> list[str]:
    """Return a line for each open alarm, the most urgent first."""
    return [
        f"{item.alarm.priority}: {item.alarm.text}{', seen' if item.acknowledged else ''}"
        for item in state.alarms
    ] or ["no alarm is open"]


def queue_lines(state: SessionState) -> list[str]:
    """Return a line for each mission that waits, the next first."""
    return [
        f"{entry.mission.id}: {entry.mission.said} ({entry.reason})" for entry in state.queue
    ] or ["no mission waits"]


def standing_lines(state: SessionState) -> list[str]:
    """Return two lines for each standing order in force: what it says, and what it has done."""
    lines: list[str] = []
    for trace in state.standing.values():
        if not trace.in_force:
            continue
        last = f", last {trace.last.mission} for {trace.last.subject}" if trace.last else ""
        lines.append(standing_in_words(trace.order))
        lines.append(f"  {trace.order.condition}; {count(trace.started, 'start')}{last}")
    return lines or ["no standing order is in force"]
