"""The control station, with one fleet, one mission queue and one stream of events."""

import asyncio
from collections.abc import AsyncGenerator, Callable
from copy import deepcopy
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from pa_console.fleets.fleet import MapsGround, PlanCountersignature, Simulated
from pa_console.language.questions import Question
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
from pa_console.schema.mission import Decision, Mission
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
from pa_console.station.answers.answering import RecentRecord, answer
from pa_console.station.camera_stills import CameraStills
from pa_console.station.clock import Clock, Ticking
from pa_console.station.control import ManualAssets, StandingControl
from pa_console.station.earlier.session_start import SessionStart
from pa_console.station.earlier.unclosed_session import ResumedSession
from pa_console.station.intake import Intake
from pa_console.station.live_reading import LiveReading, ReadAhead, ShowReading
from pa_console.station.notices import Outside, pass_on
from pa_console.station.order_entry import OrderEntry
from pa_console.station.rules_in_force import RulesReload, RulesWatch
from pa_console.station.worker import Background, MissionWorker, StationParts


class ControlStation:
    """A station with its fleet, alarms and queue; front ends use only this class."""

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
        missions automatically. With `watch`, the rule file is loaded again when it changes. Without
        `read_unasked`, the model reads ahead only while an operator types. A `resumed` session
        continues where it ended; `services` then have the fleet and the picture of that session.
        """
        self._services, self._clock, self._started = services, clock, started
        self.readonly, self._keep_engine = readonly, keep_engine
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
        self.manual = ManualAssets(
            parts, self._writable, self._look_now, self._worker.queue_changed
        )
        """The assets under manual control."""
        self._standing = StandingControl(parts, self._worker, self._writable)
        self.change_standing = self._standing.change
        self._orders = OrderEntry(
            parts,
            self._worker,
            lambda: self._reload.services,
            self.manual,
            self._standing,
            self._writable,
        )
        self.submit, self.question_in = self._orders.submit, self._orders.question_in
        self.move, self.defer = self._orders.move, self._orders.defer
        self.withdraw = self._orders.withdraw
        self.let_next_go_first = self._orders.let_next_go_first
        self._live = LiveReading(
            lambda: self._reload.services, self._orders.mission_in, self._may_read_live
        )
        self.proposals = AgentProposals(
            parts,
            self._worker,
            lambda: self._reload.services,
            self._orders.read,
            self._writable,
            resumed.before.state.muted_agents if resumed else (),
        )
        """The proposals of agents."""
        self.mute_agent = self.proposals.mute
        self._ticking = Ticking(parts, clock, self._worker, self._stop_for, self.manual)
        self._closed, self._resumed = False, resumed
        self._policy = ""
        self._stills: CameraStills | None = None
        self._record = RecentRecord(deepcopy(resumed.before.state) if resumed else SessionState())
        self._start = SessionStart(
            parts, self._worker, self.manual, self.stop_all, started, resumed
        )
        self.succeed = self._start.succeed
        self._ending: asyncio.Task[None] | None = None
        self.failure = ""
        """The internal error that ended the session; '' if there was none."""

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
        """Seconds on the fleet's clock per second of real time."""
        return self._clock.rate

    @rate.setter
    def rate(self, rate: float) -> None:
        self._clock.rate = rate

    def limit_times(self, limits: TimingLimits) -> None:
        """Set how late and how often a timed order may start; call this before `run`."""
        self._services.standing.limits = limits

    @property
    def stopped(self) -> bool:
        """True while the stop is in force."""
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
        """Return a still of a track.

        The result is None if no camera has the track in view, or if this session takes no stills.
        """
        if self._stills is None or self._closed:
            return None
        return await self._stills.take(track)

    def listen_to(self, outside: Outside | None) -> None:
        """Emit the reports of `outside`, unless it is None, in the session; call before `run`."""
        self._outside += [outside] if outside is not None else []

    async def run(self) -> AsyncGenerator[ev.Event]:
        """Yield every event of the session until `close` is called.

        If the caller stops the iteration, the session is closed too. In both cases, the last event
        in the log is the end of the session.
        """
        self._start.begin(self._ticking.first)
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
            self._orders.offer(self._policy)
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
        """Offer the world's standing order `policy` to the operator when a new session begins."""
        self._policy = policy

    async def reload_rules(self) -> None:
        """Load the rules from their file again; if this fails, emit the reason."""
        await self._reload.now()

    @property
    def rules_offered(self) -> str:
        """The reason why the rules in the file need acceptance; '' if they do not."""
        return self._reload.offered

    async def accept_rules(self) -> None:
        """Accept the refused rules, and put them in force; raises ValueError if no rules wait."""
        self._writable()
        await self._reload.accept()

    def typing(self, text: str) -> None:
        """Record the text of a mission that is being typed, so that the model reads it ahead."""
        if text.strip():
            self._ahead.typing(text)
        self._live.typing(text)

    def read_live(self, show: ShowReading | None) -> None:
        """Read orders while they are typed, and pass the live readings to `show`; None stops this.

        Nothing is logged, and no asset moves.
        """
        self._live.show_in(show)

    def _may_read_live(self) -> bool:
        """Return whether a new mission would begin at once, with the models idle."""
        taken = not (self.readonly or self.stopped or self._closed)
        return taken and self._worker.idle.is_set() and not self._worker.thinking

    def point(self, name: str) -> None:
        """Record the name marked on the screen, or ''; *this one* in an order means that name."""
        self._services.past.pointer = name

    async def read_ahead(self, text: str) -> None:
        """Wait until the model has read the current picture and all but the last word of `text`.

        Programs without an operator use this, because the model reads the same parts while an
        operator types.
        """
        await self._ahead.read_now(text)

    async def answer(
        self, question: Question, show: Callable[[Alternative], object] = lambda _: None
    ) -> ev.QuestionAnswered:
        """Answer a question from the record of this session.

        If the question asks for other plans, they are checked and rehearsed, and each is passed to
        `show` as soon as it is ready. Nothing is decided, and no asset moves.
        """
        self._live.give_way()
        answered = await answer(self._reload.services, question, self._record.state, show)
        if not self._closed:
            self._emit(answered.event, answered.mission or None)
        return answered.event

    async def examine(self, plan: Plan, text: str = "") -> Examination:
        """Check and rehearse a plan in the current picture; nothing is queued or decided.

        `text` is the order that the plan should fulfil.
        """
        task = Mission(id="examined", text=text or "Examine this plan.", created=datetime.now(UTC))
        services = self._reload.services
        standing = services.standing
        return await examine(plan, task, services.fleet, services.rulebook, standing=standing)

    def decide(self, decision: Decision) -> None:
        """Answer the open approval request.

        Raises ValueError if there is none, or if an approval cannot be logged.
        """
        self._writable()
        if decision.kind == "approve" and (problem := self._journal.commit()):
            raise ValueError(f"no approval is possible while the log cannot be written: {problem}")
        self._worker.decide(decision)

    def countersign(self, signed: PlanCountersignature) -> None:
        """Accept a second person's signature from another console for the waiting plan.

        Raises ValueError if the signature cannot be logged.
        """
        self._writable()
        if problem := self._journal.commit():
            raise ValueError(f"no approval is possible while the log cannot be written: {problem}")
        self._worker.countersign(signed)

    async def look_at(self, mission: Mission, words: str) -> RehearsedReading | None:
        """Return a rehearsed plan for another reading of a mission; nothing is decided.

        The result is None if the console finds no plan for the reading.
        """
        return await rehearse_reading(self._reload.services, mission, words)

    async def foresee(self, text: str) -> str:
        """Return the live reading of an order, with its plan; nothing is logged or decided."""
        return await self._live.line(text)

    def other_ways(
        self, mission: Mission, words: str, but: Plan
    ) -> AsyncGenerator[RehearsedReading]:
        """Yield rehearsed plans other than `but` for the same reading of a mission.

        No model is asked, and nothing is decided.
        """
        return rehearse_other_ways(self._reload.services, mission, words, but)

    def cancel(self) -> None:
        """Cancel the active mission; assets under way for it go to a safe state.

        Raises ValueError if no mission is active.
        """
        self._writable()
        self._worker.cancel()

    def acknowledge(self, alarm_id: str, by: str = "operator") -> None:
        """Record that `by` has seen an alarm; raises ValueError if the alarm is not open."""
        self._writable()
        self._emit(self._intake.alarms.acknowledge(alarm_id, by))

    def _stop_for(self, by: str) -> None:
        """Stop all assets at the request of another station, unless they are already stopped."""
        if not self.readonly and not self._gate.stopped:
            self.stop_all(by)

    def stop_all(self, by: str = "operator") -> None:
        """Send a hold to every asset, cancel the active mission and empty the queue.

        The stop stays in force until `release`: no other command is sent, no mission is accepted,
        and no alarm becomes a mission. The holds are sent before anything else is done.
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

        The release itself does not move any asset. Raises ValueError if no stop is in force.
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
        """Inject an incident into a simulated fleet.

        Raises ValueError if the incident has an unknown name, or if the fleet is not simulated.
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
        """Wait until no mission is active or waiting and every outcome has been judged."""
        while not (self._worker.idle.is_set() and self._verdicts.all_settled.is_set()):
            await self._worker.idle.wait()
            await self._verdicts.all_settled.wait()

    def worker_changed(self, state: ev.WorkerState, detail: str) -> None:
        """Emit a change of the state of the local model's process."""
        self._emit(ev.WorkerChanged(state=state, detail=detail))

    def _server_changed(
        self, server: str, serves: tuple[ev.ServerUse, ...], state: ev.ServerState, detail: str
    ) -> None:
        """Emit a change of the state of a model's server."""
        self._emit(ev.ServerChanged(server=server, serves=serves, state=state, detail=detail))

    async def close(
        self, reason: str = "closed by the operator", *, judge_outcomes: bool = False
    ) -> None:
        """Bring moving assets to safety, and end the stream with a last event.

        With `judge_outcomes`, wait for the outstanding verdicts on outcomes; otherwise, events
        report that these verdicts are missing. Even if the call is repeated or cancelled, all
        events are emitted.
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
        """Process the current picture without waiting for the next telemetry period."""
        self._ticking.look()

    def _writable(self) -> None:
        if self.readonly:
            raise ValueError("this console is read-only: commands are refused")

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
