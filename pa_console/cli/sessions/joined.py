"""A console that joins another station's session, to watch it, countersign and take command."""

import secrets
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import typer

from pa_console.cli.options import SessionOptions
from pa_console.cli.progress_bars import TransientBar
from pa_console.cli.sessions.fleet import JOINED, STATION, ask_passphrase, claim_credentials
from pa_console.cli.sessions.live import LiveSession
from pa_console.end_signals import end_signals, exit_code_of
from pa_console.fleets.key_folder import KeyFolder
from pa_console.fleets.station_authority import StationAuthority
from pa_console.fleets.vda5050.broker import BrokerAddress
from pa_console.fleets.vda5050.station_link import StationLink
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.events.event import Event, SessionStarted
from pa_console.schema.world import World
from pa_console.session.log.writer import default_folder
from pa_console.settings.sources import LoadedSettings
from pa_console.station.assembly import SessionSites, open_world
from pa_console.station.joined.joined_station import JoinedStation, Signatory, Succession
from pa_console.station.joined.shared_log import HEARD, SharedLog, read_so_far
from pa_console.terminal.output import errors, require_keys

CONNECT_S = 5.0


@dataclass(frozen=True)
class FoundSession:
    """A session that is shared on a bus, with its events so far and the keys of the site."""

    log: SharedLog
    before: list[Event]
    folder: KeyFolder


@contextmanager
def shared_session(url: str, certificates: Path | None) -> Generator[FoundSession]:
    """Yield the session that is shared at `url`; raises ValueError without a session or a key."""
    folder = KeyFolder(ask=ask_passphrase)
    if not folder.made:
        raise ValueError(
            "--join needs keys for the site: make them with 'pa-console keys make NAME --join "
            "OWNER_KEY', and ask the owner to enrol them"
        )
    address = BrokerAddress.parse(url)
    credentials = claim_credentials(address, certificates, JOINED)
    link = StationLink(address, f"{JOINED}-{secrets.token_hex(4)}", HEARD, credentials)
    try:
        if not link.wait_connected(CONNECT_S):
            raise ValueError(f"cannot connect to the broker at {address}: {link.problem}")
        log = SharedLog(link, folder.trust(), folder.take)
        with TransientBar("reading the session") as bar:
            before = read_so_far(log, bar.show)
        yield FoundSession(log, before, folder)
    finally:
        link.close()


@dataclass(frozen=True)
class JoinedSession:
    """A joined session with its world and rules, valid within its context."""

    station: JoinedStation
    world: World
    rules: Rulebook
    succession: Succession

    def show(self, settings: LoadedSettings, *, plain: bool) -> bool:
        """Show the session until the operator leaves; return whether command is to be taken.

        Raises typer.Exit if a signal ended the console.
        """
        if plain:
            from pa_console.cli.sessions.plain import run_joined_plain  # noqa: PLC0415

            question = self.command_question if self.succession.possible else None
            takes, ended_by = run_joined_plain(self.station, settings.values, question)
        else:
            takes, ended_by = self._show_screen(settings)
        if ended_by:
            raise typer.Exit(exit_code_of(ended_by))
        return takes

    def command_question(self) -> str:
        """Return the question to ask before taking command; ValueError if that is not possible."""
        authority = self.succession.prepare(self.station.started)
        return self.station.command_question(authority.trust.next_epoch, authority.name)

    def take_command(self, opened: LiveSession) -> None:
        """Take command for a session that is ready to start; raises ValueError if that fails."""
        if opened.bus is None or not opened.bus.connected:
            raise ValueError("there is no connection to the broker")
        taken = self.succession.take(opened.bus.publish_signed)
        opened.station.succeed(taken, self.station.left_missions(self.succession.last))

    @property
    def opening(self) -> str:
        """The line that is shown during the opening of a console that will take command."""
        return f"Opening the console; {self.station.station} is in command until then ..."

    @contextmanager
    def reporting_unless_taken(self) -> Generator[None]:
        """Report, if the block ends without a takeover, that the other station keeps command."""
        try:
            yield
        finally:
            if self.succession.taken is None:
                errors.print(
                    f"command was not taken: {self.station.station} is still in command",
                    style="bold red",
                )

    def _show_screen(self, settings: LoadedSettings) -> tuple[bool, int]:
        require_keys("use --plain")
        from pa_console.tui.app import ConsoleApp  # noqa: PLC0415 - Textual
        from pa_console.tui.surroundings import JoinedTo  # noqa: PLC0415

        station = self.station
        question = self.command_question if self.succession.possible else None
        app = ConsoleApp(
            self.world,
            station,
            self.rules,
            station.retriever,
            joined=JoinedTo(station.station, station.signer, question),
            settings=settings,
        )
        leaving = app.controllers.leaving
        with end_signals(leaving.end):
            app.run(mouse=settings.values.mouse)
        return leaving.takes_command, leaving.ended_by


@contextmanager
def joining(
    url: str, options: SessionOptions, settings: LoadedSettings
) -> Generator[JoinedSession]:
    """Join the session at `url`, with the world and rules of `options`, while the context lasts.

    Raises ValueError if there is no session, or if this machine lacks a key, the world or the
    rules.
    """
    with shared_session(url, options.certificates) as shared:
        log, folder, address = shared.log, shared.folder, shared.log.link.address
        person = folder.person()
        world = shared_world(shared.before, options.world, settings)
        started = _started_of(shared.before)
        rules = SessionSites((), (options.rules,)).rules_of(started)
        if rules is None:
            raise ValueError(
                f"the rules {started.rules!r} of this session are not installed here, or they "
                "have changed; give their file with --rules"
            )
        signatory = Signatory(*person)

        def own_station() -> StationAuthority:
            credentials = claim_credentials(address, options.certificates, STATION)
            if credentials is not None:
                credentials.release()
            return StationAuthority(folder.keys(person), keep=folder.take)

        yield JoinedSession(
            JoinedStation(log, shared.before, signatory, world, rules),
            world,
            rules,
            Succession(log, signatory, own_station),
        )


def shared_world(events: list[Event], given: str, settings: LoadedSettings) -> World:
    """Return the session's world, `given` or installed; raises ValueError if it is missing."""
    started = _started_of(events)
    near = (settings.values.logs or default_folder()) / "log"
    path = SessionSites((given,)).world_file(started, near)
    if path is None:
        raise ValueError(
            f"the world {started.world!r} of this session is not installed here, or it has "
            f"changed (SHA-256 {started.world_sha256[:12]}); give its file with --world"
        )
    return open_world(str(path))[0]


def _started_of(events: list[Event]) -> SessionStarted:
    """Return the event that starts the session; raises ValueError if it is not the first event."""
    started = events[0].data
    if not isinstance(started, SessionStarted):
        raise ValueError("the shared events do not begin with the start of a session")
    return started
