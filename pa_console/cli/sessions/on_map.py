"""Sessions on the map of a TAK server: this console's own, another station's, or a recorded one."""

import threading
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from pa_console.cli.options import FollowOptions
from pa_console.end_signals import end_signals, exit_code_of
from pa_console.observability import Observer
from pa_console.schema.events.event import Event
from pa_console.schema.world import World
from pa_console.session.log.writer import default_folder
from pa_console.session.past_sessions import find_session
from pa_console.session.recording import Recording
from pa_console.settings.schema import Settings
from pa_console.settings.sources import LoadedSettings
from pa_console.sim.worlds.geography import geography_of
from pa_console.sim.worlds.world_file import open_world
from pa_console.station.joined.shared_log import LOOK_S, SharedLog
from pa_console.tak.connection import Certificate, TakConnection, TakServer
from pa_console.tak.reports import TakReports
from pa_console.tak.session_on_map import InBackground, SessionOnMap, SiteOnMap, site_name
from pa_console.terminal.output import errors


@dataclass(frozen=True)
class OnMap:
    """The two directions of a TAK connection: events to the map, and reports from it."""

    take: Observer
    reports: TakReports


@contextmanager
def on_map(
    settings: Settings, world: str, tell: Callable[[str], None], say: Callable[[str], None]
) -> Generator[OnMap]:
    """Connect to the TAK server of `settings`, and yield both directions of the connection.

    `tell` is called at the end with a warning if events were not shown. `say` is called, on another
    thread, with each change of the connection. Raises ValueError if the server, the certificate or
    the origin is not valid.
    """
    certificate = Certificate.of(settings.tak_certificate, settings.tak_key, settings.tak_authority)
    server = TakServer.parse(settings.tak, certificate)
    site = placed(open_world(world)[0], settings.tak_origin)
    state = ""

    def changed(line: str) -> None:
        nonlocal state
        state = line
        say(f"TAK map: {line}")

    if server.open_to_all:
        tell(server.warning)
    contacts = settings.tak_contacts
    reports = TakReports(
        site, str(server), contacts=not server.open_to_all if contacts is None else contacts
    )
    connection = TakConnection(server, site.uid("station"), changed, reports=reports)
    try:
        with connection:
            shown = SessionOnMap(site, connection)
            try:
                with InBackground(shown.take, tell) as showing:
                    yield OnMap(showing.take, reports)
            finally:
                shown.end()
    finally:
        if connection.outbox or connection.outbox.dropped:
            tell(f"TAK map: {state}; {connection.words}")


def placed(world: World, origin: str, name: str = "", *, replay: bool = False) -> SiteOnMap:
    """Return the site, named `name` or after its world; `origin` overrides the world file's.

    Raises ValueError if the origin or the name is not valid, or if the world has no position on
    the earth.
    """
    geography = geography_of(world, origin, "--origin, --tak-origin")
    return SiteOnMap(world, geography, name or world.name, replay)


class JoinedEvents:
    """The events of a session on a bus; notices about the connection are passed to `tell`."""

    def __init__(
        self, log: SharedLog, before: list[Event], world: World, tell: Callable[[str], None]
    ) -> None:
        """Start with the events `before`; of the pictures among them, only the last is emitted."""
        self.world = world
        self._log, self._before, self._tell = log, before, tell

    @property
    def title(self) -> str:
        """The station and the address of the session, in words."""
        return f"the session of {self._log.stream.station} at {self._log.link.address}"

    def events(self, ended: Callable[[], bool]) -> Iterator[Event | None]:
        """Yield events as they arrive, and None regularly, until the end or until `ended()`."""
        taken, problem = self._before, ""
        while not ended():
            pictures = [n for n, event in enumerate(taken) if event.data.kind == "telemetry"]
            for number, event in enumerate(taken):
                if event.data.kind != "telemetry" or number == pictures[-1]:
                    yield event
                if event.data.kind == "session_ended":
                    return
            if (now := self._log.problem or self._log.link.problem) != problem:
                problem = now
                self._tell(f"the bus: {problem}" if problem else "the bus: connected again")
            self._log.link.wait_news(LOOK_S)
            taken = self._log.take()
            yield None


@dataclass(frozen=True)
class RecordedEvents:
    """The events of a recorded session at a given speed, each with the time of its display."""

    recording: Recording
    log: Path
    world: World
    speed: float

    @property
    def title(self) -> str:
        """The id of the session and its speed, in words."""
        return f"the recorded session {self.log.stem} at {self.speed:g} times its original speed"

    def events(self, ended: Callable[[], bool]) -> Iterator[Event | None]:
        """Yield events when they are due, and None regularly, until the end or until `ended()`."""
        begun, first = time.monotonic(), datetime.now(UTC)
        for number in range(len(self.recording)):
            due_s = self.recording.timeline.seconds[number] / self.speed
            while not ended() and (left_s := begun + due_s - time.monotonic()) > 0:
                time.sleep(min(left_s, LOOK_S))
                yield None
            if ended():
                return
            event = self.recording[number]
            yield event.model_copy(update={"t": first + timedelta(seconds=due_s)})


def show(follow: FollowOptions, settings: LoadedSettings) -> int:
    """Show the session on the map until it ends; return the exit code.

    Raises ValueError if the session cannot be followed, the site has no position, or the server
    cannot be used; LogError for a bad log.
    """
    server = TakServer.parse(
        follow.server, Certificate.of(follow.tls_cert, follow.tls_key, follow.tls_ca)
    )
    name = site_name(follow.name) if follow.name is not None else ""
    over, ended_by = threading.Event(), 0

    def end(number: int) -> None:
        nonlocal ended_by
        ended_by = number
        over.set()

    with _opened(follow, settings) as followed:
        site = placed(followed.world, follow.origin, name, replay=bool(follow.replay))
        connection = TakConnection(server, site.uid("station"), _report)
        pace = follow.speed if follow.replay else 1.0
        shown = SessionOnMap(site, connection, follow.every, pace)
        if server.open_to_all:
            _report(f"warning: {server.warning}")
        try:
            with end_signals(end), connection:
                _report(f"showing {followed.title}; stop with Ctrl-C")
                try:
                    for event in followed.events(over.is_set):
                        if event is not None:
                            shown.take(event)
                finally:
                    shown.end()
        finally:
            _report(connection.words)
    return exit_code_of(ended_by) if ended_by else 0


@contextmanager
def _opened(
    follow: FollowOptions, settings: LoadedSettings
) -> Generator[JoinedEvents | RecordedEvents]:
    """Open the recorded or the shared session; raises ValueError if there is none."""
    if follow.replay:
        from pa_console.cli.sessions.recorded import read_recording, world_of  # noqa: PLC0415

        log = find_session(settings.values.logs or default_folder(), follow.replay)
        recording = read_recording(log)
        world, _ = open_world(world_of(recording.started, follow.world, log))
        yield RecordedEvents(recording, log, world, follow.speed)
        return
    from pa_console.cli.sessions.joined import shared_session, shared_world  # noqa: PLC0415

    with shared_session(follow.join, follow.certificates) as shared:
        world = shared_world(shared.before, follow.world or settings.values.world, settings)
        yield JoinedEvents(shared.log, shared.before, world, _report)


def _report(line: str) -> None:
    """Print one line on stderr."""
    errors.print_line(line)
