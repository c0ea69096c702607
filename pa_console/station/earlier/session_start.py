"""The start of a session: a new session, a resumed one, or one that takes command of a site.

It dispatches no command, except a stop if the relieved station had stopped all assets.
"""

from collections.abc import Callable

from pa_console import __version__
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Metrics
from pa_console.schema.telemetry import Picture
from pa_console.station.control import ManualAssets
from pa_console.station.earlier.unclosed_session import (
    LeftMissions,
    ResumedSession,
    UnclosedSession,
)
from pa_console.station.worker import MissionWorker, StationParts

INTERRUPTED = "the console ended while it was under way; give it again if it is still needed"
NOT_KEPT = "a standing order ends with its console; give it again if it is still needed"


class SessionStart:
    """The beginning of a session; a `resumed` session continues where it ended."""

    def __init__(  # noqa: PLR0917
        self,
        parts: StationParts,
        worker: MissionWorker,
        manual: ManualAssets,
        stop_all: Callable[[str], None],
        started: ev.SessionStarted,
        resumed: ResumedSession | None,
    ) -> None:
        """Restore the parts of a resumed session.

        `stop_all` stops all assets; its argument names the relieved station that had stopped them.
        """
        self._intake, self._emit, self._manual = parts.intake, parts.emit, manual
        self._worker, self._stop_all = worker, stop_all
        self._started, self._resumed = started, resumed
        self._taken: ev.CommandTaken | None = None
        self._left = LeftMissions()
        self._again: list[tuple[ev.EventPayload, str]] = []
        """The events of the missions that are queued again for open alarms, with their ids."""
        if resumed is None:
            return
        before, services = resumed.before, parts.services
        missions = before.state.missions.values()
        services.gate.resume(resumed.stops, stopped=before.state.stop is not None)
        manual.take_up(before.manual, before.awaiting)
        services.standing.skip_ids(
            trace.standing.order.id for trace in missions if trace.standing is not None
        )
        unanswered = [trace.mission.alarm for trace in before.interrupted if trace.mission.alarm]
        self._again = self._intake.take_up(
            resumed.alarms, before.waiting, len(missions), unanswered
        )

    def succeed(self, taken: ev.CommandTaken, left: LeftMissions) -> None:
        """Record the takeover with which this session begins; call this before `begin`.

        `left` contains the open missions of the other session. Those that have sent no commands are
        queued here, which dispatches nothing.
        """
        self._taken, self._left = taken, left

    def begin(self, picture: Picture) -> None:
        """Emit the first events, with the first `picture`, and queue the missions that continue."""
        if self._resumed is not None:
            self._go_on(self._resumed.before, picture)
            return
        self._emit(self._started, None)
        if self._taken is not None:
            self._emit(self._taken, None)
        self._emit(ev.TelemetryReceived(picture=picture), None)
        if self._taken is not None:
            self._take_over(self._taken.station, self._left)

    def _go_on(self, before: UnclosedSession, picture: Picture) -> None:
        """Emit that the session continues, and queue its waiting missions; dispatch nothing."""
        interrupted = tuple(trace.mission.id for trace in before.interrupted)
        in_force = [trace.order.id for trace in before.state.standing.values() if trace.in_force]
        self._emit(ev.SessionResumed(version=__version__, interrupted=interrupted), None)
        self._emit(ev.TelemetryReceived(picture=picture), None)
        self._hold(interrupted, INTERRUPTED)
        for order_id in in_force:
            revoked = ev.StandingOrderRevoked(order_id=order_id, by="the console", reason=NOT_KEPT)
            self._emit(revoked, None)
        self._hold(before.started_by_standing, NOT_KEPT)
        for payload, mission in self._again:
            self._emit(payload, mission)
        self._worker.queue_changed()

    def _hold(self, missions: tuple[str, ...], reason: str) -> None:
        """End `missions`, which are not resumed."""
        for mission in missions:
            held = ev.MissionFinished(status="held", reason=reason, metrics=Metrics())
            self._emit(held, mission)

    def _take_over(self, station: str, left: LeftMissions) -> None:
        """Emit notices about the relieved `station`'s open missions; queue the undispatched ones.

        If the station had stopped all assets, they are stopped, and no mission is queued.
        """
        for text in left.notices(station):
            self._emit(ev.Noticed(level="warning", subject="command", text=text), None)
        for asset, by in left.manual:
            self._manual.take(asset, f"{by} at {station}")
        if left.stopped:
            self._stop_all(station)
            return
        for mission in left.again:
            again, received = self._intake.wait_again(mission)
            self._emit(received, again.id)
        self._worker.queue_changed()
