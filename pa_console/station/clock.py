"""The clocks of a session, and the loop that steps the fleet and processes telemetry."""

import asyncio
from collections.abc import Callable, Generator
from contextlib import contextmanager
from time import perf_counter
from typing import Protocol

from pa_console.mission.orders.standing import Due, Ended, Withheld
from pa_console.schema.events import event as ev
from pa_console.schema.telemetry import Picture
from pa_console.session.state import BY_CLOCK
from pa_console.station.control import ManualAssets
from pa_console.station.notices import Noticer
from pa_console.station.worker import MissionWorker, StationParts

MAX_STEPS_AT_ONCE = 20
IDLE_S = 0.005
LATE_S = 2.0
"""The delay from which a timed mission counts as late, in seconds."""
OVER = "its last scheduled time has passed"
FAULT_AGAIN_S = 10.0
"""The interval after which a recurring internal error is reported again, in seconds."""


class Clock(Protocol):
    """A clock that determines how many simulation steps are due."""

    waits: bool
    """True if the world stands still while a model is asked."""

    @property
    def rate(self) -> float:
        """Seconds on the fleet's clock per second of real time."""
        ...

    @rate.setter
    def rate(self, rate: float) -> None: ...

    async def due(self, dt_s: float, waiting: Callable[[], bool]) -> int:
        """Wait until steps are due, and return their number.

        `waiting` returns True if another part of the station waits for a step.
        """
        ...


class RealTimeClock:
    """A clock with `rate` simulated seconds per second; it does not catch up after a long delay."""

    waits = False

    def __init__(self, rate: float = 1.0) -> None:
        self.rate = rate
        self._owed = 0.0
        self._last = perf_counter()

    async def due(self, dt_s: float, waiting: Callable[[], bool]) -> int:  # noqa: ARG002
        """Sleep for about one step and return the number of steps due; `waiting` has no effect."""
        await asyncio.sleep(dt_s / max(self.rate, 1.0))
        now = perf_counter()
        self._owed += (now - self._last) * self.rate / dt_s
        self._last = now
        steps = min(int(self._owed), MAX_STEPS_AT_ONCE)
        self._owed = min(self._owed - steps, 1.0)
        return steps


class DevicesClock:
    """A clock for the real time of devices, whose rate cannot be changed."""

    waits = False

    def __init__(self, rate: float = 1.0) -> None:
        self._clock = RealTimeClock(rate)

    @property
    def rate(self) -> float:
        """Seconds on the devices' clock per second of real time."""
        return self._clock.rate

    @rate.setter
    def rate(self, rate: float) -> None:
        """Ignore `rate`, because real devices have a fixed rate."""

    async def due(self, dt_s: float, waiting: Callable[[], bool]) -> int:
        """Sleep for about one step and return the number of steps due."""
        return await self._clock.due(dt_s, waiting)


class SteppedClock:
    """A clock that steps as fast as possible while a follower waits for a step, and else stops."""

    rate = 1.0
    waits = True

    async def due(self, dt_s: float, waiting: Callable[[], bool]) -> int:  # noqa: ARG002
        """Return 1 if a follower waits for a step, 0 otherwise."""
        await asyncio.sleep(0.0)
        if not waiting():
            await asyncio.sleep(IDLE_S)
        return 1 if waiting() else 0


class Ticking:
    """The loop that steps the fleet and emits its events."""

    def __init__(
        self,
        parts: StationParts,
        clock: Clock,
        worker: MissionWorker,
        stop: Callable[[str], None],
        manual: ManualAssets,
    ) -> None:
        """Process the first picture; `stop` is called with the source of a stop request."""
        self._stop, self._manual = stop, manual
        self._services, self._feed, self._intake = parts.services, parts.feed, parts.intake
        self._emergency_stop, self._emit = parts.emergency_stop, parts.emit
        self._clock, self._worker, self._fleet = clock, worker, parts.services.fleet
        self.first = self._fleet.picture()
        """The first picture of the session."""
        self._noticer, self._taken = Noticer(self.first), frozenset[str]()
        self._see_manual(self.first)
        self._refusal, self._fault = "", ("", 0.0)
        self._services.sightings.look(self.first)

    async def run(self) -> None:
        """Step the world when the clock says so, and process telemetry once in each period.

        A stepped clock stands still while a mission is being planned or waits for a decision.
        """
        world = self._fleet.world
        every = max(1, round(world.telemetry_period_s / world.dt_s))
        while True:
            for _ in range(await self._clock.due(world.dt_s, self._wanted)):
                with self._kept_going():
                    self._step()
                if self._fleet.tick % every == 0:
                    self.look()

    def _step(self) -> None:
        """Step the world once; a stop request is handled before other received messages."""
        self._services.journal.commit()
        received = self._fleet.step()
        if received.stop_asked:
            self._stop(received.stop_asked)
        for payload in self._emergency_stop.step((self._fleet.tick, received.replies)):
            self._emit(payload, None)
        self._feed.publish(self._fleet.tick, received.replies)
        for event in received.told:
            self.happened(event)
        for signed in received.countersigned:
            self._worker.countersign(signed)

    @contextmanager
    def _kept_going(self) -> Generator[None]:
        """Report an error and continue, because after its end a session cannot stop assets."""
        try:
            yield
        except Exception as error:
            fault = f"{type(error).__name__}: {error}"
            now_s = perf_counter()
            if fault == self._fault[0] and now_s - self._fault[1] < FAULT_AGAIN_S:
                return
            self._fault = fault, now_s
            text = f"the picture may be out of date; STOP works: internal error: {fault}"[:500]
            self._emit(ev.Noticed(level="alarm", subject="station", text=text), None)

    def happened(self, event: ev.IncidentHappened | ev.Noticed) -> None:
        """Emit an event of the fleet; a `worker` incident also kills the model's process."""
        self._emit(event, None)
        if isinstance(event, ev.IncidentHappened) and event.incident.kind == "worker":
            self._services.engine.kill_worker()

    def _wanted(self) -> bool:
        """Return whether a follower waits for a step and no mission is being planned."""
        return (self._feed.wanted or self._emergency_stop.waiting) and not self._worker.thinking

    def look(self) -> None:
        """Process the current picture; an error is reported, and the session continues."""
        with self._kept_going():
            self._look()

    def _look(self) -> None:
        """Process new telemetry: emit it, raise alarms, and queue missions for alarms."""
        picture = self._fleet.picture()
        self._see_manual(picture)
        for notice in self._noticer.look(picture):
            self._emit(notice, None)
        self._services.sightings.look(picture)
        self._emit(ev.TelemetryReceived(picture=picture), None)
        if (refusal := self._services.gate.refusal) != self._refusal:
            self._refusal = refusal
            self._emit(ev.AuthorityChanged(refusal=refusal), None)
        stopped = self._services.gate.stopped
        arrivals = self._intake.look(picture, self._worker.handled, stopped=stopped)
        for payload, mission in arrivals.payloads:
            self._emit(payload, mission)
        for mission in arrivals.obsolete:
            self._worker.drop(mission, "its cause is gone")
        self._manual.queue_returned()
        self._start_standing(picture, stopped=stopped)
        self._worker.queue_changed()
        self._worker.see(picture)

    def _see_manual(self, picture: Picture) -> None:
        """Record which assets are under manual control.

        The changes produce no notices here, because an operator's change is emitted when it is
        made.
        """
        gate = self._services.gate
        gate.see(picture)
        taken = frozenset(gate.manual.taken)
        for asset in taken ^ self._taken:
            self._noticer.knows_manual(asset, manual=asset in taken)
        self._taken = taken

    def _start_standing(self, picture: Picture, *, stopped: bool) -> None:
        """Queue the missions that standing orders start now.

        If an order cannot start its mission or has ended, this is emitted.
        """
        standing = self._services.standing
        standing.time.take(picture.time_s, self._clock.rate, stepped=self._clock.waits)
        busy = self._worker.handled | self._intake.subjects
        for start in standing.look(picture, busy, stopped=stopped):
            match start:
                case Due():
                    mission, received = self._intake.start(start)
                    standing.started(mission.id, start)
                    self._emit(received, mission.id)
                    late_s = start.late_s if start.late_s >= LATE_S else 0.0
                    began = ev.StandingOrderStarted(
                        order_id=start.order.id, subject=start.subject, late_s=late_s
                    )
                    self._emit(began, mission.id)
                case Withheld(order, subject, reason):
                    withheld = ev.StandingOrderWithheld(
                        order_id=order.id, subject=subject, reason=reason
                    )
                    self._emit(withheld, None)
                case Ended(order):
                    over = ev.StandingOrderRevoked(order_id=order.id, by=BY_CLOCK, reason=OVER)
                    self._emit(over, None)
                case ev.StandingOrderScheduled():
                    self._emit(start, None)
