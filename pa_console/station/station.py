"""The control station: one fleet, one mission queue, one stream of events."""

import asyncio
from collections.abc import AsyncGenerator, Callable
from copy import deepcopy
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from pa_console import __version__
from pa_console.fleets.fleet import MapsGround, PlanCountersignature, Simulated
from pa_console.language.orders.order_changes import ManualWords, OrderChange, read_manual
from pa_console.language.questions import Question
from pa_console.language.references.conversation import Unclear, corrects
from pa_console.language.references.scene import ReferenceScene
from pa_console.mission.context import Services
from pa_console.mission.examine import Examination, examine
from pa_console.mission.execution.dispatch import StepFeed
from pa_console.mission.orders.agenda import TimingLimits
from pa_console.mission.stop import EmergencyStop
from pa_console.mission.verify import OutcomeVerdicts
from pa_console.policy.retriever import Retriever
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.events import event as ev
from pa_console.schema.incident import Incident
from pa_console.schema.mission import Decision, Metrics, Mission
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import RehearsedReading
from pa_console.schema.world import Background as GroundMap
from pa_console.schema.world import World
from pa_console.session.log.writer import LogWriter
from pa_console.session.state import SessionState
from pa_console.station.agents import AgentProposals
from pa_console.station.answers.alternatives import (
    Alternative,
    rehearse_other_ways,
    rehearse_reading,
)
from pa_console.station.answers.answering import IS_QUESTION, RecentRecord, answer
from pa_console.station.camera_stills import CameraStills
from pa_console.station.clock import Clock, Ticking
from pa_console.station.control import ManualAssets, StandingControl
from pa_console.station.earlier_session import LeftMissions, ResumedSession, UnclosedSession
from pa_console.station.intake import IS_STOPPED, Intake, ReadText, read_text
from pa_console.station.live_reading import LiveReading, ReadAhead, ShowReading
from pa_console.station.notices import Outside, pass_on
from pa_console.station.rules_in_force import RulesReload, RulesWatch
from pa_console.station.worker import Background, MissionWorker, StationParts

INTERRUPTED = "the console ended while it was under way; give it again if it is still wanted"
NOT_KEPT = "a standing order ends with its console; give it again if it is still wanted"


class ControlStation:
    """The owner of the fleet, the alarms and the queue; front ends use only this class."""

    def __init__(
        self,
        services: Services,
        clock: Clock,
        started: ev.SessionStarted,
        *,
        readonly: bool = False,
        keep_engine: bool = False,
        respond: bool = False,
        watch: RulesWatch | None = None,
        read_unasked: bool = True,
        resumed: ResumedSession | None = None,
    ) -> None:
        """Begin a session with the event `started`; `clock` determines when the world is stepped.

        The engine is closed with the session unless `keep_engine`. With `respond`, alarms become
        missions automatically. With `watch`, a changed rule file is loaded at once. Without
        `read_unasked`, the model reads ahead only while an operator types. A `resumed` session
        continues where it ended; `services` have its fleet and its picture.
        """
        self._services, self._clock, self._started = services, clock, started
        self.readonly, self._keep_engine = readonly, keep_engine
        self._taken: ev.CommandTaken | None = None
        self._left = LeftMissions()
        self._outside: list[Outside] = []
        self._fleet, self._journal = services.fleet, services.journal
        self._feed = StepFeed()
        self._events: asyncio.Queue[ev.Event | None] = asyncio.Queue()
        self._intake = Intake(self.world, started.session, respond=respond and not readonly)
        self._gate = services.gate
        self._emergency_stop = EmergencyStop(self._fleet, self._gate)
        self._background = Background(self._broken)
        self._verdicts = OutcomeVerdicts(self._background.start, between_missions=clock.waits)
        parts = StationParts(
            services, self._feed, self._intake, self._emergency_stop, self._verdicts, self._emit
        )
        self._worker = MissionWorker(parts)
        self._ahead = ReadAhead(services, unasked=read_unasked)
        self._reload = RulesReload(services, watch, self._emit, self._worker, self._ahead)
        self._live = LiveReading(lambda: self._reload.services, self._order_in, self._may_read_live)
        self.proposals = AgentProposals(
            parts,
            self._worker,
            lambda: self._reload.services,
            self._read,
            self._writable,
            resumed.before.state.muted_agents if resumed else (),
        )
        """The agents' proposals."""
        self.mute_agent = self.proposals.mute
        self.manual = ManualAssets(
            parts, self._writable, self._look_now, self._worker.queue_changed
        )
        """The assets under manual control."""
        self._standing = StandingControl(parts, self._worker, self._writable)
        self.change_standing = self._standing.change
        self._ticking = Ticking(parts, clock, self._worker, self._stop_for, self.manual)
        self._closed, self._resumed = False, resumed
        self._policy = ""
        self._stills: CameraStills | None = None
        self._record = RecentRecord(deepcopy(resumed.before.state) if resumed else SessionState())
        self._again: list[tuple[ev.EventPayload, str]] = []
        """The events with which missions of open alarms begin again, each with its mission."""
        if resumed is not None:
            before = resumed.before
            missions = before.state.missions.values()
            self._gate.resume(resumed.stops, stopped=before.state.stop is not None)
            self.manual.take_up(before.manual, before.awaiting)
            services.standing.skip_ids(one.standing.order.id for one in missions if one.standing)
            unanswered = [one.mission.alarm for one in before.interrupted if one.mission.alarm]
            self._again = self._intake.take_up(
                resumed.alarms, before.waiting, len(missions), unanswered
            )
        self._last_read: tuple[tuple[str, ReferenceScene, Rulebook], ReadText] | None = None
        self._ending: asyncio.Task[None] | None = None
        self.failure = ""
        """The internal error that ended the session; '' for none."""

    @property
    def session(self) -> str:
        """The id of the session."""
        return self._started.session

    @property
    def world(self) -> World:
        """The world of the fleet."""
        return self._fleet.world

    @property
    def ground(self) -> GroundMap | None:
        """The newest ground map made by the robots; None if there is none."""
        return self._fleet.background if isinstance(self._fleet, MapsGround) else None

    @property
    def retriever(self) -> Retriever:
        """The retriever over the rules in force now."""
        return self._reload.services.retriever

    @property
    def rulebook(self) -> Rulebook:
        """The rules in force now."""
        return self._reload.services.rulebook

    @property
    def rate(self) -> float:
        """Simulated seconds per second."""
        return self._clock.rate

    @rate.setter
    def rate(self, rate: float) -> None:
        self._clock.rate = rate

    def limit_times(self, limits: TimingLimits) -> None:
        """Set how late a timed order may start, and how often; call this before `run`."""
        self._services.standing.limits = limits

    @property
    def stopped(self) -> bool:
        """True while the stop is latched."""
        return self._gate.stopped

    @property
    def worked_on(self) -> str:
        """The id of the active mission; '' if there is none."""
        return self._worker.worked_on

    @property
    def awaits_decision(self) -> bool:
        """True while a plan waits for `decide`."""
        return self._worker.awaits_decision

    def write_to(self, log: LogWriter) -> None:
        """Write every event of the session to `log` before any other part receives it.

        While the log cannot be written, only stops and ways to safety are dispatched.
        """
        self._journal.open(log, self._emit)

    def take_stills(self, log: Path) -> None:
        """Take stills for the operator from now on, and keep them beside `log`."""
        self._stills = self._stills or CameraStills(self._fleet, log, self._emit)

    async def still_of(self, track: str) -> ev.CameraStill | None:
        """Return a still of a track; None if no camera has it in view, or no stills are taken."""
        if self._stills is None or self._closed:
            return None
        return await self._stills.take(track)

    def listen_to(self, outside: Outside | None) -> None:
        """Emit the reports of `outside`, if any, in the session as well; call this before `run`."""
        self._outside += [outside] if outside is not None else []

    def succeed(self, taken: ev.CommandTaken, left: LeftMissions) -> None:
        """Record the takeover with which this session begins; call this before `run`.

        Undispatched missions that the other session `left` are queued here; that dispatches
        nothing.
        """
        self._taken, self._left = taken, left

    async def run(self) -> AsyncGenerator[ev.Event]:
        """Yield every event of the session until `close`; stopping the iteration closes it too.

        In either case, the log ends with the end of the session.
        """
        if self._resumed is None:
            self._emit(self._started)
            if self._taken is not None:
                self._emit(self._taken)
            self._emit(ev.TelemetryReceived(picture=self._ticking.first))
            if self._taken is not None:
                self._take_over(self._taken.station, self._left)
        else:
            self._go_on(self._resumed.before)
        if problem := self._gate.objection(self._services.rulebook):
            self._emit(ev.Noticed(level="alarm", subject="keys", text=problem))
        self._services.engine.on_state = self.worker_changed
        for server, uses in self._services.servers.backends.items():
            server.on_state = partial(self._server_changed, server.name, uses)
            await server.start()
        ahead, serving = self._ahead, self._worker.serve(self._background, self._between)
        for work in (
            self._ticking.run(),
            serving,
            ahead.load(),
            ahead.serve(),
            self._reload.serve(),
        ):
            self._background.start(work)
        if self._resumed is None and not self.readonly and self._policy:
            self._offer(self._policy)
        for outside in self._outside:
            self._background.start(pass_on(outside, self._emit))
        try:
            while (event := await self._events.get()) is not None:
                yield event
        finally:
            await self.close("interrupted")
            self._fleet.close()
            for server in self._services.servers.backends:
                await server.close()
            if not self._keep_engine:
                await self._services.engine.close()

    def offer_at_start(self, policy: str) -> None:
        """Offer a standing order of the world to the operator when a new session begins."""
        self._policy = policy

    def _offer(self, policy: str) -> None:
        mission, received = self._intake.submit(self._read(policy), active=False, offered=True)
        self._emit(received, mission.id)
        self._worker.queue_changed()

    def _go_on(self, before: UnclosedSession) -> None:
        """Emit that the session continues and queue its waiting missions; nothing is dispatched."""
        interrupted = tuple(trace.mission.id for trace in before.interrupted)
        given = [each.order.id for each in before.state.standing.values() if each.in_force]
        started = before.started_by_standing
        self._emit(ev.SessionResumed(version=__version__, interrupted=interrupted))
        self._emit(ev.TelemetryReceived(picture=self._ticking.first))
        for name in interrupted:
            held = ev.MissionFinished(status="held", reason=INTERRUPTED, metrics=Metrics())
            self._emit(held, name)
        for name in given:
            self._emit(ev.StandingOrderRevoked(order_id=name, by="the console", reason=NOT_KEPT))
        for name in started:
            held = ev.MissionFinished(status="held", reason=NOT_KEPT, metrics=Metrics())
            self._emit(held, name)
        for payload, mission in self._again:
            self._emit(payload, mission)
        self._worker.queue_changed()

    def _take_over(self, station: str, left: LeftMissions) -> None:
        """Emit the relieved `station`'s open missions and queue the undispatched ones."""
        for text in left.notices(station):
            self._emit(ev.Noticed(level="warning", subject="command", text=text))
        for asset, by in left.manual:
            self.manual.take(asset, f"{by} at {station}")
        if left.stopped:
            self.stop_all(station)
            return
        for mission in left.again:
            again, received = self._intake.wait_again(mission)
            self._emit(received, again.id)
        self._worker.queue_changed()

    async def reload_rules(self) -> None:
        """Load the rules from their file again; if that fails, emit the reason."""
        await self._reload.now()

    @property
    def rules_offered(self) -> str:
        """The reason why the rules in their file wait for acceptance; '' if they do not."""
        return self._reload.offered

    async def accept_rules(self) -> None:
        """Accept the refused rules and put them in force; raises ValueError if none wait."""
        self._writable()
        await self._reload.accept()

    def typing(self, text: str) -> None:
        """Record the text of a mission that is being typed; the model reads it meanwhile."""
        if text.strip():
            self._ahead.typing(text)
        self._live.typing(text)

    def read_live(self, show: ShowReading | None) -> None:
        """Read the order that is being typed and pass its reading to `show`; None stops reading.

        Nothing is logged, and no asset moves.
        """
        self._live.show_in(show)

    def _order_in(self, text: str) -> ReadText | None:
        """Return `text` as it is read; None for a question or a change that is made at once."""
        order = self._read(text)
        return order if order.question is None and self._change_in(order) is None else None

    def _may_read_live(self) -> bool:
        """Return whether a new mission would begin at once and the models are idle."""
        taken = not (self.readonly or self.stopped or self._closed)
        return taken and self._worker.idle.is_set() and not self._worker.thinking

    def point(self, name: str) -> None:
        """Record the name marked on the screen, '' for none; *this one* in an order means it."""
        self._services.past.pointer = name

    async def read_ahead(self, text: str) -> None:
        """Wait until the model has read the present picture and all but the last word of `text`.

        This simulates an operator who types.
        """
        await self._ahead.read_now(text)

    def question_in(self, text: str) -> Question | None:
        """Return the question about the record in `text`, for `answer`; None for an order."""
        return self._read(text).question

    def _read(self, text: str) -> ReadText:
        """Return a text as it is read; the last result is reused in the same situation.

        A front end asks whether a text is a question, and then submits it.
        """
        services = self._reload.services
        now = (text, services.scene, services.rulebook)
        if self._last_read is None or self._last_read[0] != now:
            self._last_read = now, read_text(*now)
        return self._last_read[1]

    async def answer(
        self, question: Question, found: Callable[[Alternative], object] = lambda _: None
    ) -> ev.QuestionAnswered:
        """Answer a question from the record of this session.

        Other plans are checked and rehearsed if the question asks for them; each is passed to
        `found` as soon as it is ready. Nothing is decided, and no asset moves.
        """
        self._live.give_way()
        given = await answer(self._reload.services, question, self._record.state, found)
        if not self._closed:
            self._emit(given.told, given.mission or None)
        return given.told

    def submit(self, text: str) -> Mission:
        """Queue a mission (paper, Step 1); raises ValueError if it is not accepted.

        A question about the record is not accepted. A change that takes effect at once is carried
        out and recorded as a mission.
        """
        self._writable()
        order = self._read(text)
        change = self._change_in(order)
        if isinstance(change, Unclear):
            raise ValueError(change.question)
        if change is not None:
            return self._change(order, change)
        if self.stopped:
            raise ValueError(IS_STOPPED)
        if order.question is not None:
            raise ValueError(IS_QUESTION)
        if corrected := self._corrected(order):
            withdrawn = Decision(kind="reject", reason=f"corrected: “{order.typed}”")
            self._worker.decide(withdrawn)
            if corrected == "takes back":
                return self._done_at_once(order, "the plan that waited is withdrawn")
        mission, received = self._intake.submit(order, self._worker.busy)
        self._emit(received, mission.id)
        self._worker.queue_changed()
        return mission

    def _corrected(self, order: ReadText) -> str:
        """Return how `order` corrects the operator's own waiting plan; '' if it does not."""
        active = self._worker.active
        if active is None or not self._worker.awaits_decision or not active.proposes:
            return ""
        return corrects(order.text) if active.mission.source == "operator" else ""

    def _change_in(self, order: ReadText) -> OrderChange | ManualWords | Unclear | None:
        """Return the change of a standing order or of manual control in a text; None for none."""
        change = self._standing.read(order.text)
        if change is not None or order.question is not None:
            return change
        return read_manual(self._services.scene, order.text, self._gate.manual.taken)

    def _change(self, order: ReadText, change: OrderChange | ManualWords) -> Mission:
        """Carry out an operator's change at once and record it as a mission.

        Raises ValueError if the change is not possible.
        """
        if isinstance(change, OrderChange):
            reason = self._standing.carry_out(change)
        else:
            reason = self.manual.change(change)
        return self._done_at_once(order, reason)

    def _done_at_once(self, order: ReadText, reason: str) -> Mission:
        """Record an order that was carried out at once as a finished mission."""
        mission, received = self._intake.submit(order, active=False, waits=False)
        self._emit(received, mission.id)
        ended = ev.MissionFinished(status="verified", reason=reason, metrics=Metrics())
        self._emit(ended, mission.id)
        return mission

    async def examine(self, plan: Plan, text: str = "") -> Examination:
        """Check and rehearse a plan in the present picture, without queuing or deciding anything.

        `text` is the order that the plan should serve.
        """
        task = Mission(id="examined", text=text or "Examine this plan.", created=datetime.now(UTC))
        services = self._reload.services
        standing = services.standing
        return await examine(plan, task, services.fleet, services.rulebook, standing=standing)

    def decide(self, decision: Decision) -> None:
        """Answer the open approval request; raises ValueError if there is none.

        Also raises ValueError for an approval that cannot be logged.
        """
        self._writable()
        if decision.kind == "approve" and (problem := self._journal.commit()):
            raise ValueError(f"nothing is approved while the log cannot be written: {problem}")
        self._worker.decide(decision)

    def countersign(self, signed: PlanCountersignature) -> None:
        """Accept a second person's signature from elsewhere for the waiting plan.

        Raises ValueError for a signature that cannot be logged.
        """
        self._writable()
        if problem := self._journal.commit():
            raise ValueError(f"nothing is approved while the log cannot be written: {problem}")
        self._worker.countersign(signed)

    async def look_at(self, mission: Mission, asked: str) -> RehearsedReading | None:
        """Rehearse a plan for another reading of a mission, without deciding anything.

        The result is None if the console has no plan for it.
        """
        return await rehearse_reading(self._reload.services, mission, asked)

    async def foresee(self, text: str) -> str:
        """Return the line on how an order is read and planned now; nothing is logged or decided."""
        return await self._live.line(text)

    def other_ways(
        self, mission: Mission, asked: str, but: Plan
    ) -> AsyncGenerator[RehearsedReading]:
        """Rehearse other plans than `but` for the same reading of a mission.

        No model is asked, and nothing is decided.
        """
        return rehearse_other_ways(self._reload.services, mission, asked, but)

    def cancel(self) -> None:
        """Cancel the active mission; assets under way for it go to a safe state.

        Raises ValueError if no mission is active.
        """
        self._writable()
        self._worker.cancel()

    def acknowledge(self, alarm_id: str, by: str = "operator") -> None:
        """Record that `by` has seen an alarm; raises ValueError for an unknown one."""
        self._writable()
        self._emit(self._intake.alarms.acknowledge(alarm_id, by))

    def move(self, mission_id: str, by: int) -> None:
        """Move a waiting mission by `by` places in the queue; ValueError if it does not wait."""
        self._reorder(lambda: self._intake.move(mission_id, by))

    def let_next_go_first(self) -> None:
        """Move the next mission ahead of the active one, which then waits again.

        Raises ValueError if no mission waits, or an asset is already moving for the active one.
        """
        self._writable()
        self._worker.let_next_go_first()

    def defer(self, mission_id: str) -> None:
        """Move a waiting mission behind all others; raises ValueError if it does not wait."""
        self._reorder(lambda: self._intake.queue.defer(mission_id))

    def withdraw(self, mission_id: str) -> None:
        """Cancel a waiting mission; raises ValueError if it does not wait."""
        reason = "withdrawn by the operator"
        self._reorder(lambda: self._worker.drop(self._intake.queue.remove(mission_id), reason))

    def _stop_for(self, by: str) -> None:
        """Stop all assets at the request of another station, unless they are already stopped."""
        if not self.readonly and not self._gate.stopped:
            self.stop_all(by)

    def stop_all(self, by: str = "operator") -> None:
        """Send a hold to every asset, cancel the active mission and empty the queue.

        The stop is latched: until `release`, no other command leaves the station, no mission is
        accepted, and no alarm becomes one. The holds are sent before anything else is done.
        """
        self._writable()
        holds = self._emergency_stop.hold_all()
        self._gate.manual.forget()
        self._emit(ev.AllStopped(by=by))
        for payload in holds:
            self._emit(payload)
        for mission in self._intake.queue.take():
            self._worker.drop(mission, "stopped by the operator")
        if self._worker.busy:
            self._worker.cancel()
        self._worker.queue_changed()

    def release(self, by: str = "operator") -> None:
        """Release the stop: missions are accepted again, and open alarms become missions.

        The release alone moves no asset. Raises ValueError if nothing is stopped.
        """
        self._writable()
        self._gate.release()
        self._emergency_stop.release()
        self._emit(ev.StopReleased(by=by))
        for payload, mission in self._intake.resume(self._worker.handled):
            self._emit(payload, mission)
        self.manual.queue_returned()
        self._worker.queue_changed()

    def inject(self, incident: Incident) -> None:
        """Make an incident happen in a simulated fleet.

        Raises ValueError for an unknown name, and for a fleet that is not simulated.
        """
        self._writable()
        if not isinstance(self._fleet, Simulated):
            raise ValueError("incidents can only be made to happen in a simulated fleet")
        self._fleet.inject(incident)
        self._ticking.happened(ev.IncidentHappened(incident=incident, source="operator"))

    async def advance(self, seconds: float) -> None:
        """Wait until `seconds` of simulated time have passed."""
        end = self._fleet.tick + round(seconds / self.world.dt_s)
        with self._feed.follow() as steps:
            async for tick, _ in steps:
                if tick >= end:
                    return

    async def settled(self) -> None:
        """Wait until no mission is active, none waits, and every outcome is judged."""
        while not (self._worker.idle.is_set() and self._verdicts.all_settled.is_set()):
            await self._worker.idle.wait()
            await self._verdicts.all_settled.wait()

    def worker_changed(self, state: ev.WorkerState, detail: str) -> None:
        """Emit a change in the state of the LLM worker."""
        self._emit(ev.WorkerChanged(state=state, detail=detail))

    def _server_changed(
        self, server: str, serves: tuple[ev.ServerUse, ...], state: ev.ServerState, detail: str
    ) -> None:
        """Emit a change in the state of a model's server."""
        self._emit(ev.ServerChanged(server=server, serves=serves, state=state, detail=detail))

    async def close(
        self, reason: str = "closed by the operator", *, judge_outcomes: bool = False
    ) -> None:
        """Bring moving assets to safety, and end the stream with a last event.

        With `judge_outcomes`, wait for the outstanding verdicts on outcomes; otherwise events
        report that there are none. The call may be repeated or cancelled: all events are emitted in
        any case.
        """
        if self._closed:
            return
        self._closed = True
        self._live.close()
        try:
            await self._background.stop()
            if judge_outcomes:
                await self._verdicts.work()
        finally:
            self._verdicts.give_up(f"the session ended before the verdict came: {reason}")
            self._emit(ev.SessionEnded(reason=reason))
            self._events.put_nowait(None)

    async def _between(self) -> None:
        """Use the model between two missions: for outstanding verdicts, then for reading ahead."""
        if await self._verdicts.work():
            await self._ahead.load()

    def _look_now(self) -> None:
        """Process the picture without waiting for the next telemetry."""
        self._ticking.look()

    def _writable(self) -> None:
        if self.readonly:
            raise ValueError("this console is read-only: commands are refused")

    def _reorder(self, change: Callable[[], None]) -> None:
        self._writable()
        change()
        self._worker.queue_changed()

    def _emit(self, payload: ev.EventPayload, mission: str | None = None) -> None:
        event = ev.Event(t=datetime.now(UTC), tick=self._fleet.tick, mission=mission, data=payload)
        self._journal.append(event)
        self._record.take(event)
        if self._stills is not None:
            trace = self._record.state.missions.get(mission or "")
            self._stills.see(payload, trace.mission if trace is not None else None)
        self._live.see(payload)
        self._ahead.see(payload)
        self._events.put_nowait(event)
        if isinstance(payload, ev.MissionFinished) and mission:
            self._standing.mission_ended(mission, payload)

    def _broken(self, error: BaseException) -> None:
        """End the session in order after one of its own tasks has failed."""
        self.failure = f"internal error: {type(error).__name__}: {error}"
        self._ending = asyncio.create_task(self.close(self.failure))
