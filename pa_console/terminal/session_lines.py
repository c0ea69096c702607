"""A session in lines of text: its events, its state, and the lines that are typed."""

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Callable, Coroutine, Sequence
from contextlib import aclosing
from dataclasses import dataclass
from time import monotonic

from pa_console.language.canonical.reading import plain_reading
from pa_console.language.questions import Question
from pa_console.schema.events import event as ev
from pa_console.schema.telemetry import AssetTelemetry, Picture
from pa_console.schema.text import clock_text, count
from pa_console.session.state import MissionTrace, SessionState
from pa_console.session.state_parts import Notice
from pa_console.session.wording import link_in_words, links_in_words, order_in_words
from pa_console.station.joined.joined_station import JoinedStation
from pa_console.station.station import ControlStation
from pa_console.terminal.mission import step_line
from pa_console.terminal.typed_lines import is_stop
from pa_console.views.event_words import next_in_words, standing_in_words
from pa_console.views.status_words import status_of
from pa_console.views.trace_layout import progress

_LEVELS = ("warning", "alarm")


def status_lines(state: SessionState) -> list[str]:
    """Return lines with time, gates, stop, model, active mission, and numbers of waiting items."""
    picture, lines = state.picture, list[str]()
    if picture is not None:
        lines.append(f"time {clock_text(picture.time_s)}, weather {picture.weather}")
        uncovered = [name for name, cover in picture.gates.items() if not cover.covered]
        lines.append(
            f"gates not covered: {', '.join(uncovered)}" if uncovered else "all gates covered"
        )
        lines += links_in_words(picture)
        driven = [f"{a.id} ({_by_hand(a, state)})" for a in picture.assets.values() if a.manual]
        lines += [f"MANUAL; nothing is sent to: {', '.join(driven)}"] if driven else []
    if state.stop is not None:
        held, open_ = state.stop.held, state.stop.unconfirmed
        named = [
            f"{name} ({why})" if (why := state.stop.overdue.get(name)) else name for name in open_
        ]
        waits = f"; not confirmed by {', '.join(named)}" if named else ""
        lines.append(f"STOPPED: {count(held, 'asset')} held{waits}; release ends the stop")
    if state.log_problem:
        lines.append(f"the log cannot be written; nothing is dispatched: {state.log_problem}")
    if state.relieved:
        lines.append(f"NOT IN COMMAND; nothing is sent: {state.relieved}")
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
    waiting, alarms = count(len(state.queue), "mission"), count(len(state.alarms), "alarm")
    lines.append(f"{waiting} waiting, {alarms} open")
    return lines


def asset_lines(state: SessionState) -> list[str]:
    """Return a line for each asset: its place, its task, and its condition."""
    if state.picture is None:
        return ["no telemetry yet"]
    return [_asset_line(asset, state, state.picture) for asset in state.picture.assets.values()]


def _asset_line(asset: AssetTelemetry, state: SessionState, picture: Picture) -> str:
    place = f"at {asset.at}" if asset.at else f"to {asset.post}"
    link = f"link {asset.comms} {link_in_words(asset.id, picture.links)}".rstrip()
    facts = [f"{asset.task} {place}", asset.status, f"battery {asset.charge}", link]
    if why := picture.not_ready.get(asset.id):
        facts.append(f"not ready: {why}")
    if asset.stale:
        facts.append("telemetry is stale")
    if asset.manual:
        facts += ["MANUAL", _by_hand(asset, state)]
    return f"{asset.id}: {', '.join(facts)}"


def _by_hand(asset: AssetTelemetry, state: SessionState) -> str:
    """Return, in words, who took an asset, or that the asset itself reports manual control."""
    taken = state.manual.get(asset.id)
    return f"taken by {taken.by}" if taken is not None else "by its own report"


def alarm_lines(state: SessionState) -> list[str]:
    """Return a line for each open alarm, the most urgent first."""
    return [
        f"{item.alarm.priority}: {item.alarm.text}{', seen' if item.acknowledged else ''}"
        for item in state.alarms
    ] or ["no open alarms"]


def queue_lines(state: SessionState) -> list[str]:
    """Return a line for each waiting mission, the next mission first."""
    return [
        f"{entry.mission.id}: {entry.mission.said} ({entry.reason})" for entry in state.queue
    ] or ["no waiting missions"]


def standing_lines(state: SessionState) -> list[str]:
    """Return two lines for each standing order in force: its text, and its starts so far."""
    lines: list[str] = []
    for trace in state.standing.values():
        if not trace.in_force:
            continue
        last = f", last {trace.last.mission}" if trace.last else ""
        last += f" for {trace.last.subject}" if trace.last and trace.last.subject else ""
        following = next_in_words(trace.next, state.time_s)
        waits = trace.order.condition or f"next {following}"
        waits += ", paused" if trace.paused and trace.order.condition else ""
        lines.append(standing_in_words(trace.order))
        lines.append(f"  {waits}; {count(trace.started, 'start')}{last}")
    return lines or ["no standing orders in force"]


_TABLES = {"status": status_lines, "assets": asset_lines, "alarms": alarm_lines,
           "queue": queue_lines, "standing": standing_lines}  # fmt: skip


@dataclass(frozen=True)
class LineOutput:
    """The functions with which a line console prints texts, a plan and a mission's trace."""

    say: Callable[[str], None]
    show_plan: Callable[[MissionTrace, int], None]
    show_trace: Callable[[MissionTrace], None]
    hold_s: float = 0.0
    """The time in seconds after a plan appears during which an answer is refused as too early."""
    called: Callable[[], None] = lambda: None
    """A function that is called when the console waits for the operator."""


class SessionLines(ABC):
    """A line console, which shows the events of a session and carries out typed lines."""

    def __init__(self, station: ControlStation | JoinedStation, output: LineOutput) -> None:
        self._conversing, self._output, self._say = station, output, output.say
        self.state = SessionState()
        """The state of the session, as far as its events were received here."""
        self._last_notice: Notice | None = None
        self._confirming: Callable[[], None] | None = None
        self._reason, self._shown_at = "", 0.0
        self._answering: set[asyncio.Task[None]] = set()

    @property
    def request(self) -> ev.ApprovalRequested | None:
        """The approval request of the waiting plan; None if no plan waits."""
        current = self.state.current
        return current.approval if current is not None else None

    async def run(
        self, lines: asyncio.Queue[str | None], forget: Callable[[], None] = lambda: None
    ) -> None:
        """Show the session until it ends or is left; `forget` drops lines that were typed early."""
        self._forget = forget
        self._begin()
        work = [asyncio.create_task(each) for each in self._work(lines)]
        try:
            async with aclosing(self._conversing.run()) as events:
                async for event in events:
                    self._take(event)
                    await asyncio.sleep(0)
        finally:
            for task in work:
                task.cancel()
            await asyncio.gather(*work, return_exceptions=True)

    @abstractmethod
    def interrupted(self) -> None:
        """Respond to Ctrl-C."""

    # Differences between the kinds of consoles

    @abstractmethod
    def _begin(self) -> None:
        """Print the first lines."""

    @abstractmethod
    def _heed(self, event: ev.Event) -> None:
        """Respond to an event that was shown."""

    @abstractmethod
    async def _no_more_lines(self) -> None:
        """Continue after the end of the input."""

    @abstractmethod
    def _stop(self) -> None:
        """Stop all assets."""

    @abstractmethod
    def _command(self, line: str) -> bool:
        """Carry out a line that is a command of this console; return whether it is one."""

    @abstractmethod
    def _answer_or_order(self, line: str) -> None:
        """Process a line as an answer to the waiting plan, or as an order."""

    # Events

    def _work(self, lines: asyncio.Queue[str | None]) -> Sequence[Coroutine[None, None, None]]:
        """Return the coroutines that run while events are shown."""
        return (self._listen(lines),)

    def _take(self, event: ev.Event) -> None:
        """Show an event, respond to it, and then show its lines in the event list."""
        self.take(event)
        self._heed(event)
        self.show_notice(event)

    def _await_answer(self) -> None:
        """Call the operator to the plan that has just been shown."""
        self._forget()
        self._shown_at = monotonic()
        self._output.called()

    @property
    def _too_early(self) -> bool:
        """True while the operator cannot yet have read the waiting plan."""
        return monotonic() - self._shown_at < self._output.hold_s

    # Typed lines

    async def _listen(self, lines: asyncio.Queue[str | None]) -> None:
        while (line := await lines.get()) is not None:
            if line.strip():
                self._do(line.strip())
        await self._no_more_lines()

    def _do(self, line: str) -> None:
        """Carry out one line, or print its error."""
        confirming, self._confirming = self._confirming, None
        word = line.casefold()
        try:
            if is_stop(line):
                self._stop()
            elif confirming is not None and word == "yes":
                confirming()
            elif confirming is not None and word == "no":
                self._say("nothing was changed")
            elif not self.look(word) and not self._command(line) and not self._asks(line):
                self._answer_or_order(line)
        except ValueError as error:
            self._say(str(error))

    def _confirm(self, question: str, do: Callable[[], None]) -> None:
        self._confirming = do
        self._say(question)

    def _asks(self, line: str) -> bool:
        """Start to answer a line if it is a question about the record; return whether it is.

        Later lines do not wait for the answer.
        """
        question = self._conversing.question_in(line)
        if question is None:
            return False
        task = asyncio.create_task(self._show_answer(question))
        self._answering.add(task)
        task.add_done_callback(self._answering.discard)
        return True

    async def _show_answer(self, question: Question) -> None:
        """Show the answer line by line; a waiting plan continues to wait."""
        answer = await self._conversing.answer(question)
        for line in answer.lines:
            self._say(f"{line.about}: {line.said}")

    # Output

    def fold(self, event: ev.Event) -> None:
        """Process an event without showing it."""
        self.state.apply(event)
        self._last_notice = self._newest_notice()

    def take(self, event: ev.Event) -> None:
        """Process an event and show it; a waiting plan is shown by `show`."""
        self._last_notice = self._newest_notice()
        with_still = frozenset(self.state.stills)
        self.state.apply(event)
        if line := step_line(event):
            self._say(line)
        match event.data:
            case ev.CommandReplied(reply=reply) if reply.status in ("done", "failed", "refused"):
                self._say(f"{reply.agent} {reply.status}{f': {reply.detail}' * bool(reply.detail)}")
            case ev.CommandSent(command=command) if event.mission is None:
                self._say(f"{command.agent}: {order_in_words(command)}")
            case ev.DecisionMade(accepted=False, detail=detail):
                self._say(f"decision not accepted: {detail}")
            case ev.MissionReported(text=text):
                self._say(text.strip())
            case ev.CameraStill(track=track, camera=camera, sha256=str(sha256)):
                if track not in with_still:
                    self._say(f"{camera} sees {track}: still {sha256[:12]}… beside the log")
            case ev.SessionEnded(reason=reason):
                self._say(f"the session has ended: {reason}")
            case _:
                pass

    def show_notice(self, event: ev.Event) -> None:
        """Show the new lines of the event list after `event`, unless a step has shown them."""
        last = self._newest_notice()
        if last is None or last is self._last_notice:
            return
        self._last_notice = last
        hidden = last.hidden or event.mission is not None or last.level not in _LEVELS
        if not hidden:
            self._say(f"{last.level.upper()}  {last.subject}: {last.text}")
            if last.level == "alarm":
                self._output.called()

    def show(self, request: ev.ApprovalRequested, waits: str, how: str) -> None:
        """Print the plan of a request, who must decide on it (`waits`), and `how` to answer."""
        trace = self.state.current
        if trace is not None:
            self._output.show_plan(trace, request.attempt)
        status = status_of("approval", request.state or "none")
        subject = "A plan" if request.standing is None else f"Standing order {request.standing.id}"
        self._say(f"{subject} waits for {waits}. {status.word}.")
        for reason in request.blocked_by:
            self._say(f"blocked: {reason}")
        if request.acknowledge:
            self._say(f"broken rules that you must accept: {', '.join(request.acknowledge)}")
        for number, reading in enumerate(request.readings, start=1):
            self._say(f"reading {number}: {plain_reading(reading)}")
        self._say(how)

    def look(self, word: str) -> bool:
        """Show the part of the state that `word` names; return whether it names one."""
        if word in _TABLES:
            for line in _TABLES[word](self.state):
                self._say(line)
        elif word == "trace" and self.state.current is not None:
            self._output.show_trace(self.state.current)
        else:
            return False
        return True

    def _newest_notice(self) -> Notice | None:
        notices = self.state.notices
        return notices[-1] if notices else None
