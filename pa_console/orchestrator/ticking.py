"""Moves the world on as the clock says, and takes in what is seen of it: telemetry, alarms."""

from pa_console.orchestrator.clock import Clock
from pa_console.orchestrator.desk import Desk, Emit
from pa_console.orchestrator.feed import StepFeed
from pa_console.orchestrator.intake import Intake
from pa_console.orchestrator.notices import Noticer
from pa_console.orchestrator.services import Services
from pa_console.orchestrator.stops import Stops
from pa_console.schema import event as ev
from pa_console.schema.incident import Incident


class Ticking:
    """Steps one simulation and tells everything that happens in it."""

    def __init__(  # noqa: PLR0917
        self,
        services: Services,
        clock: Clock,
        feed: StepFeed,
        intake: Intake,
        stops: Stops,
        desk: Desk,
        emit: Emit,
    ) -> None:
        """Take the first look at the picture."""
        self._services, self._clock, self._feed = services, clock, feed
        self._intake, self._stops, self._desk, self._emit = intake, stops, desk, emit
        self._sim = services.sim
        self.first = self._sim.picture()
        """The picture that the session begins with."""
        self._noticer = Noticer(self.first)
        services.sightings.look(self.first)

    async def run(self) -> None:
        """Move the world on whenever the clock says so, and report telemetry at its own period.

        A clock that lets the world wait for the mission does so while it is thought about only.
        """
        world = self._sim.world
        every = max(1, round(world.telemetry_period_s / world.dt_s))
        while True:
            for _ in range(await self._clock.due(world.dt_s, self._wanted)):
                self._services.journal.commit()
                replies = tuple(self._sim.step())
                self._feed.publish(self._sim.tick, replies)
                for incident in self._sim.take_incidents():
                    self.happened(incident, "scenario")
                for text in self._sim.take_skipped():
                    self._emit(ev.Noticed(level="warning", subject="scenario", text=text), None)
                for payload in self._stops.step((self._sim.tick, replies)):
                    self._emit(payload, None)
                if self._sim.tick % every == 0:
                    self._look()

    def happened(self, incident: Incident, source: ev.IncidentSource) -> None:
        """Tell an incident that has taken effect; the one that strikes the model does so here."""
        self._emit(ev.IncidentHappened(incident=incident, source=source), None)
        if incident.kind == "worker":
            self._services.engine.kill_worker()

    def _wanted(self) -> bool:
        """Return whether somebody waits for the world to move, and nobody thinks about it."""
        return (self._feed.wanted or self._stops.waiting) and not self._desk.thinking

    def _look(self) -> None:
        """Take in new telemetry: tell it, raise alarms, queue their missions."""
        picture = self._sim.picture()
        for notice in self._noticer.look(picture):
            self._emit(notice, None)
        self._services.sightings.look(picture)
        self._emit(ev.TelemetryReceived(picture=picture), None)
        stopped = self._services.gate.stopped
        arrivals = self._intake.look(picture, self._desk.handled, stopped=stopped)
        for payload, mission in arrivals.payloads:
            self._emit(payload, mission)
        for mission in arrivals.obsolete:
            self._desk.drop(mission, "its cause is gone")
        self._desk.queue_changed()
        self._desk.see(picture)
