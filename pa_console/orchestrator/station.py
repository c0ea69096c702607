"""The control station: one simulation, one mission queue, one stream of everything that happens."""

import asyncio
from collections import deque
from collections.abc import AsyncGenerator, Coroutine
from contextlib import suppress
from datetime import UTC, datetime

from pa_console.llm.errors import EngineError
from pa_console.llm.prompts import fixed_part
from pa_console.orchestrator.clock import Clock
from pa_console.orchestrator.feed import StepFeed
from pa_console.orchestrator.notices import notices
from pa_console.orchestrator.pipeline import MissionRun
from pa_console.orchestrator.services import Services
from pa_console.schema import event as ev
from pa_console.schema.command import DeviceCommand
from pa_console.schema.incident import Incident
from pa_console.schema.mission import MAX_MISSION_TEXT, Decision, Mission, MissionStatus
from pa_console.schema.world import World

ROLES: tuple[ev.Role, ...] = ("planner", "judge")
READ_ONLY = "this console is read-only: commands are refused"


class Station:
    """Owns the simulation and works on one mission at a time; both front ends use only this."""

    def __init__(
        self,
        services: Services,
        clock: Clock,
        started: ev.SessionStarted,
        *,
        readonly: bool = False,
        keep_engine: bool = False,
    ) -> None:
        """`started` is the session's first event; `clock` says when the world moves on.

        The engine is closed with the session unless `keep_engine`.
        """
        self._services, self._clock, self._started = services, clock, started
        self.readonly, self._keep_engine = readonly, keep_engine
        self.rulebook, self.retriever = services.rulebook, services.retriever
        self._sim = services.sim
        self._feed = StepFeed()
        self._events: asyncio.Queue[ev.Event | None] = asyncio.Queue()
        self._queue: deque[Mission] = deque()
        self._arrived = asyncio.Event()
        self._run: MissionRun | None = None
        self._work: asyncio.Task[None] | None = None
        self._answer: asyncio.Future[Decision] | None = None
        self._missions = self._halts = 0
        self._tasks: set[asyncio.Task[None]] = set()
        self._last = self._sim.picture()
        self._closed = False

    @property
    def session(self) -> str:
        """The id of the session."""
        return self._started.session

    @property
    def world(self) -> World:
        """The world that is simulated."""
        return self._sim.world

    @property
    def rate(self) -> float:
        """Simulated seconds per second."""
        return self._clock.rate

    @rate.setter
    def rate(self, rate: float) -> None:
        self._clock.rate = rate

    async def run(self) -> AsyncGenerator[ev.Event]:
        """Yield every event of the session until `close`; stopping the iteration closes it too."""
        self._emit(self._started)
        self._emit(ev.TelemetryReceived(picture=self._last))
        self._services.engine.on_state = self.worker_changed
        for work in (self._tick(), self._serve(), self._read_ahead()):
            self._start(work)
        try:
            while (event := await self._events.get()) is not None:
                yield event
        finally:
            for task in list(self._tasks):
                task.cancel()
                with suppress(asyncio.CancelledError, Exception):
                    await task
            if not self._keep_engine:
                await self._services.engine.close()

    def submit(self, text: str) -> Mission:
        """Step 1: queue a mission; raises ValueError when it cannot be taken."""
        words = " ".join(text.split())
        if self.readonly:
            raise ValueError(READ_ONLY)
        if not words:
            raise ValueError("the mission is empty: say what is to be done")
        if len(words) > MAX_MISSION_TEXT:
            raise ValueError(
                f"the mission has {len(words)} characters, at most {MAX_MISSION_TEXT} are taken"
            )
        self._missions += 1
        mission = Mission(
            id=f"M{self._missions:03d}-{self._started.session[-4:]}",
            text=words,
            created=datetime.now(UTC),
        )
        self._queue.append(mission)
        position = len(self._queue) - 1 + (self._run is not None)
        self._emit(ev.MissionReceived(mission=mission, position=position), mission.id)
        self._arrived.set()
        return mission

    def decide(self, decision: Decision) -> None:
        """Answer the open approval request; raises ValueError when there is none."""
        if self.readonly:
            raise ValueError(READ_ONLY)
        if self._answer is None or self._answer.done():
            raise ValueError("no plan waits for a decision")
        self._answer.set_result(decision)

    def cancel(self) -> None:
        """Cancel the mission being worked on; assets under way for it hold."""
        if self.readonly:
            raise ValueError(READ_ONLY)
        if self._work is not None:
            self._work.cancel()

    def stop_all(self, by: str = "operator") -> None:
        """Every available asset holds, the active mission is cancelled, the queue is emptied."""
        if self.readonly:
            raise ValueError(READ_ONLY)
        for mission in list(self._queue):
            run = MissionRun(self._services, mission, self._feed, self._decided)
            for payload in run.close("cancelled", "stopped by the operator"):
                self._emit(payload, mission.id)
        self._queue.clear()
        self.cancel()
        self._emit(ev.AllStopped(by=by))
        self._halts += 1
        for number, asset in enumerate(self._sim.picture().assets.values(), start=1):
            if asset.available:
                command = DeviceCommand(
                    command_id=f"stop{self._halts}.{number}", agent=asset.id, verb="hold"
                )
                self._sim.send(command)
                self._emit(ev.CommandSent(command=command))

    def inject(self, incident: Incident) -> None:
        """Let something happen in the simulation; raises ValueError for an unknown name."""
        if self.readonly:
            raise ValueError(READ_ONLY)
        self._sim.inject(incident)
        self._emit(ev.IncidentHappened(incident=incident))

    async def advance(self, seconds: float) -> None:
        """Wait until `seconds` of simulated time have passed."""
        end = self._sim.tick + round(seconds / self.world.dt_s)
        with self._feed.follow() as steps:
            async for tick, _ in steps:
                if tick >= end:
                    return

    def worker_changed(self, state: ev.WorkerState, detail: str) -> None:
        """Pass a change of the LLM worker on to the event stream."""
        self._emit(ev.WorkerChanged(state=state, detail=detail))

    async def close(self, reason: str = "closed by the operator") -> None:
        """End the stream after a last event; safe to call twice."""
        if not self._closed:
            self._closed = True
            self._emit(ev.SessionEnded(reason=reason))
            self._events.put_nowait(None)

    def _emit(self, payload: ev.EventPayload, mission: str | None = None) -> None:
        self._events.put_nowait(
            ev.Event(t=datetime.now(UTC), tick=self._sim.tick, mission=mission, data=payload)
        )

    async def _tick(self) -> None:
        """Move the world on whenever the clock says so, and report telemetry at its own period."""
        every = max(1, round(self.world.telemetry_period_s / self.world.dt_s))
        while True:
            steps = await self._clock.due(self.world.dt_s, waiting=self._feed.wanted)
            for _ in range(steps):
                self._feed.publish(self._sim.tick + 1, self._sim.step())
                if self._sim.tick % every == 0:
                    picture = self._sim.picture()
                    for notice in notices(self._last, picture):
                        self._emit(notice)
                    self._last = picture
                    self._emit(ev.TelemetryReceived(picture=picture))

    async def _serve(self) -> None:
        """Work on the queued missions, one at a time, in the order in which they came."""
        while True:
            while not self._queue:
                self._arrived.clear()
                await self._arrived.wait()
            mission = self._queue.popleft()
            self._run = MissionRun(self._services, mission, self._feed, self._decided)
            self._work = self._start(self._work_on(self._run))
            await asyncio.wait([self._work])
            self._run = self._work = None
            self._start(self._read_ahead())

    async def _read_ahead(self) -> None:
        """Load the model and let it read what never changes while nobody waits for it."""
        engine = self._services.engine
        with suppress(EngineError):  # told by the engine's state, and to whoever asks it
            await engine.start()
            for role in ROLES:
                await engine.warm(role, fixed_part(role, self.world))

    async def _work_on(self, run: MissionRun) -> None:
        """Emit everything a mission yields; a cancelled or broken mission ends in safety."""
        mission = run.mission.id
        try:
            async for payload in run.payloads():
                self._emit(payload, mission)
        except asyncio.CancelledError:
            self._abandon(run, "cancelled", "cancelled by the operator")
        except Exception as error:  # a defect must neither end the session nor move an asset
            self._abandon(run, "failed", f"internal error: {type(error).__name__}: {error}")

    def _abandon(self, run: MissionRun, status: MissionStatus, reason: str) -> None:
        self._halts += 1
        for command in run.execution.halt(self._halts):
            self._emit(ev.CommandSent(command=command), run.mission.id)
        for payload in run.close(status, reason):
            self._emit(payload, run.mission.id)

    async def _decided(self) -> Decision:
        """Wait for `decide`."""
        self._answer = asyncio.get_running_loop().create_future()
        try:
            return await self._answer
        finally:
            self._answer = None

    def _start(self, work: Coroutine[None, None, None]) -> asyncio.Task[None]:
        """Run `work` beside the rest of the session."""
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._task_ended)
        return task

    def _task_ended(self, task: asyncio.Task[None]) -> None:
        """End the session in order when one of its own tasks broke."""
        self._tasks.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            self._emit(ev.SessionEnded(reason=f"internal error: {error}"))
            self._events.put_nowait(None)
