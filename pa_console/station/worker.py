"""The work on missions, one at a time in the queue's order, and the session's background tasks."""

import asyncio
from collections import deque
from collections.abc import Callable, Coroutine
from dataclasses import dataclass

from pa_console.fleets.fleet import PlanCountersignature
from pa_console.language.orders.order_changes import Change
from pa_console.mission.context import MissionResult, Services
from pa_console.mission.decide import countersignature
from pa_console.mission.execution.dispatch import StepFeed
from pa_console.mission.run import MissionRun, StationSide
from pa_console.mission.stop import EmergencyStop
from pa_console.mission.verify import OutcomeVerdicts
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Decision, Mission
from pa_console.schema.telemetry import Picture
from pa_console.station.intake import Intake

MOST_COUNTERSIGNED = 16
UNANSWERED_S = 60.0
"""The time after which a plan that nobody has answered gives way to a mission that needs no
approval, in seconds."""
NEXT_TURN_S = 300.0
"""The time until a mission that needs no approval has another turn, if its own plan had to wait for
an answer and got none, in seconds."""
NOBODY_ANSWERS = "it needs no approval, and nobody has answered"
EmitFor = Callable[[ev.EventPayload, str | None], None]
"""A function that emits an event for the mission with the given id, or without a mission (None)."""


class Background:
    """The tasks that run beside a session."""

    def __init__(self, on_failure: Callable[[BaseException], None]) -> None:
        """If a task fails, `on_failure` is called with its error."""
        self._on_failure = on_failure
        self._tasks: set[asyncio.Task[object]] = set()

    def start(self, work: Coroutine[None, None, object]) -> asyncio.Task[object]:
        """Start `work` as a task and return the task."""
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._ended)
        return task

    async def stop(self) -> None:
        """Cancel every task and wait until all have ended."""
        tasks = list(self._tasks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    def _ended(self, task: asyncio.Task[object]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            self._on_failure(error)


@dataclass(frozen=True)
class StationParts:
    """The objects that the parts of a station share."""

    services: Services
    feed: StepFeed
    intake: Intake
    emergency_stop: EmergencyStop
    verdicts: OutcomeVerdicts
    emit: EmitFor


class MissionWorker:
    """The worker that carries out the missions in the queue, and emits their events."""

    def __init__(self, parts: StationParts) -> None:
        self._services, self._intake = parts.services, parts.intake
        self._emergency_stop, self._emit = parts.emergency_stop, parts.emit
        self._verdicts = parts.verdicts
        self._side = StationSide(
            parts.feed, self._decided, parts.verdicts, lambda: self._intake.alarms.open
        )
        self.idle = asyncio.Event()
        """An event that is set while no mission is active or waits."""
        self.idle.set()
        self._arrived = asyncio.Event()
        self._runs: dict[str, MissionRun] = {}
        self._run: MissionRun | None = None
        self._work: asyncio.Task[object] | None = None
        self._gives_way = False
        self._cancelled_for = "cancelled by the operator"
        self._answer: asyncio.Future[Decision] | None = None
        self._countersigned: deque[Decision] = deque(maxlen=MOST_COUNTERSIGNED)
        self._asked_at_s = 0.0
        """The time of the last approval request, on the fleet's clock."""
        self._requested: dict[str, float] = {}
        """The open missions for which approval was requested, each with the time when it last
        waited for an answer, on the fleet's clock."""
        self._first = ""
        """The id of the mission that was last moved ahead of the active mission."""

    @property
    def active(self) -> MissionRun | None:
        """The run of the active mission; None if no mission is active."""
        return self._run

    @property
    def busy(self) -> bool:
        """True while a mission is active."""
        return self._run is not None

    @property
    def worked_on(self) -> str:
        """The id of the active mission; '' if there is none."""
        return self._run.mission.id if self._run is not None else ""

    @property
    def thinking(self) -> bool:
        """True while the active mission is planned or waits, or an outcome is still being judged.

        During this time, no asset moves for a mission.
        """
        if self._run is None:
            return not self._verdicts.all_settled.is_set()
        return not self._run.moving

    @property
    def handled(self) -> frozenset[str]:
        """The tracks, assets and gates with which the active mission deals."""
        return self._run.subjects if self._run is not None else frozenset()

    async def serve(
        self, background: Background, between: Callable[[], Coroutine[None, None, None]]
    ) -> None:
        """Carry out missions until cancelled; start `between` after each mission."""
        while True:
            mission = self._intake.queue.pop_next()
            if mission is None:
                self._arrived.clear()
                self.idle.set()
                await self._arrived.wait()
                continue
            self._run = self._runs.setdefault(mission.id, self._new_run(mission))
            self.queue_changed()
            self._work = background.start(self._work_on(self._run))
            await asyncio.wait([self._work])
            self._leave(self._run, interrupted=self._work.cancelled())
            self._run, self._work, self._gives_way = None, None, False
            background.start(between())

    def use(self, services: Services) -> None:
        """Use `services` for new missions; missions that have begun keep their earlier services."""
        self._services = services

    @property
    def awaits_decision(self) -> bool:
        """True while a plan waits for a decision."""
        return self._answer is not None and not self._answer.done()

    def queue_changed(self) -> None:
        """Emit the queue if it has changed, and wake the worker."""
        for payload in self._intake.changes():
            self._emit(payload, None)
        if self._intake.queue.missions:
            self.idle.clear()
            self._arrived.set()

    def decide(self, decision: Decision) -> None:
        """Answer the open approval request; raises ValueError if there is none."""
        if self._answer is None or not self.awaits_decision:
            raise ValueError("no plan is waiting for a decision")
        self._answer.set_result(decision)

    def countersign(self, signed: PlanCountersignature) -> None:
        """Accept a second person's signature from another console for the waiting or next plan."""
        self._countersigned.append(countersignature(signed))
        if self._answer is not None and not self._answer.done():
            self._answer.set_result(self._countersigned.popleft())

    def cancel(self, reason: str = "cancelled by the operator") -> None:
        """Cancel the active mission, even if it is about to give way to an emergency.

        Raises ValueError if no mission is active.
        """
        if self._work is None:
            raise ValueError("no mission is active; withdraw a waiting mission from the queue")
        self._gives_way, self._cancelled_for = False, reason
        self._work.cancel()

    def change_steps(self, change: Change, by: str = "operator") -> None:
        """Pause, resume or end the active order in steps.

        Raises ValueError if there is no such order, or if `change` does not apply to it.
        """
        if self._run is None or not self._run.in_steps:
            raise ValueError("no order in steps is under way")
        match change:
            case "revoke":
                self.cancel(f"revoked by {by}")
            case "skip":
                raise ValueError(f"{self._run.mission.id} is under way: there is no time to skip")
            case "pause" | "resume":
                self._run.pause(paused=change == "pause", by=by)

    def see(self, picture: Picture) -> None:
        """Pass new telemetry to the active mission, and let it give way to another if necessary.

        The mission gives way to an emergency (WF-04). If nobody answers its approval request, it
        also gives way to a mission of a standing order that needs no approval.
        """
        if self._run is None or self._work is None or self._work.done():
            return
        mission = self._run.mission
        self._run.see(picture)
        moving = self._run.moving
        entry = None if self._gives_way else self._intake.emergency(mission, moving=moving)
        # A mission that was moved ahead stays active if approval of the other was requested before.
        kept = (
            mission.id == self._first and entry is not None and entry.mission.id in self._requested
        )
        if entry is not None and not kept:
            self._give_way(self._run, self._work, entry.mission.id, entry.reason)
        elif not self._gives_way and (unasked := self._unasked(picture.time_s)) is not None:
            self._let_first(self._run, self._work, unasked, NOBODY_ANSWERS)

    def let_next_go_first(self) -> None:
        """Move the next mission ahead of the active one, which waits again and is planned anew.

        Raises ValueError if no mission is active, if no mission waits, or if an asset is moving for
        the active mission.
        """
        run, work = self._run, self._work
        if run is None or work is None or work.done():
            raise ValueError("no mission is active: the next mission begins automatically")
        if run.moving:
            raise ValueError(f"{run.mission.id} is under way: cancel it, or wait for its end")
        waiting = self._intake.queue.entries
        if not waiting:
            raise ValueError("no mission waits")
        self._let_first(run, work, waiting[0].mission, "the operator's order")

    def _unasked(self, time_s: float) -> Mission | None:
        """Return a waiting mission that needs no approval, if the active plan has waited too long.

        If approval was already requested for a mission, it is returned only after NEXT_TURN_S.
        """
        if not self.awaits_decision or time_s - self._asked_at_s < UNANSWERED_S:
            return None
        for entry in self._intake.queue.entries:
            order = self._services.standing.find(entry.mission.standing)
            had_turn_s = self._requested.get(entry.mission.id)
            due = had_turn_s is None or time_s - had_turn_s >= NEXT_TURN_S
            if due and order is not None and order.unasked:
                return entry.mission
        return None

    def _let_first(
        self, run: MissionRun, work: asyncio.Task[object], mission: Mission, reason: str
    ) -> None:
        self._intake.queue.let_first(mission.id, run.mission.id)
        self._first = mission.id
        self._give_way(run, work, mission.id, reason)

    def _give_way(self, run: MissionRun, work: asyncio.Task[object], by: str, reason: str) -> None:
        self._gives_way = True
        if run.mission.id in self._requested:
            self._requested[run.mission.id] = self._services.fleet.time_s
        self._emit(ev.MissionPreempted(by=by, reason=reason), run.mission.id)
        work.cancel()

    def drop(self, mission: Mission, reason: str) -> None:
        """End a waiting mission that will not be carried out."""
        run = self._runs.pop(mission.id, None) or self._new_run(mission)
        self._requested.pop(mission.id, None)
        run.close(MissionResult("cancelled", reason))

    async def _work_on(self, run: MissionRun) -> None:
        """Carry out a mission; if it is interrupted or fails, bring its assets to safety."""
        try:
            await run.work()
        except asyncio.CancelledError:
            self._to_safety(run)
            raise
        except Exception as error:  # a defect must neither end the session nor move an asset
            self._to_safety(run)
            reason = f"internal error: {type(error).__name__}: {error}"
            run.close(MissionResult("failed", reason))

    def _leave(self, run: MissionRun, *, interrupted: bool) -> None:
        """Release a mission that is over, was cancelled, or gave way and waits again."""
        if interrupted and self._gives_way and self._intake.put_back(run.mission):
            return
        self._runs.pop(run.mission.id, None)
        self._requested.pop(run.mission.id, None)
        if interrupted:
            why = "its cause is gone" if self._gives_way else self._cancelled_for
            run.close(MissionResult("cancelled", why))

    def _to_safety(self, run: MissionRun) -> None:
        for payload in self._emergency_stop.follow(run.halt()):
            self._emit(payload, run.mission.id)

    def _new_run(self, mission: Mission) -> MissionRun:
        def emit(payload: ev.EventPayload) -> None:
            self._emit(payload, mission.id)

        return MissionRun(self._services, mission, emit, self._side)

    def _decided(self) -> asyncio.Future[Decision]:
        """Return a future for the decision; meanwhile, the idle model judges other outcomes."""
        self._verdicts.go_on()
        self._answer = answer = asyncio.get_running_loop().create_future()
        self._asked_at_s = self._services.fleet.time_s
        self._requested[self.worked_on] = self._asked_at_s
        if self._countersigned:
            answer.set_result(self._countersigned.popleft())
        return answer
