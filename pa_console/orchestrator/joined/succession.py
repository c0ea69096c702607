"""A commander at a console that has joined takes command; this station's own session follows."""

from collections.abc import Callable

from pa_console.fleets.authorization import RefusedError
from pa_console.fleets.station_authority import StationAuthority
from pa_console.orchestrator.joined.joined_station import Signatory
from pa_console.orchestrator.joined.shared_log import SharedLog
from pa_console.schema.events.event import CommandTaken, Event, SessionStarted

OwnStation = Callable[[], StationAuthority]
"""Return the keys of the station of this machine; raises ValueError where it cannot command."""


class Succession:
    """Takes command from the station whose session was joined, in the name of the person here.

    Everything that can fail comes before `take`: from then on vehicles accept nothing from the
    other station, and nothing from this one before its session begins.
    """

    def __init__(self, log: SharedLog, signatory: Signatory, own: OwnStation) -> None:
        self._log, self._signatory, self._own = log, signatory, own
        self.authority: StationAuthority | None = None
        """The keys that this station commands with, once it was found that it may."""
        self.taken: CommandTaken | None = None
        """Command as it was taken, None before."""
        self.last: tuple[Event, ...] = ()
        """The events of the other session after its console had closed, until command was taken."""

    @property
    def possible(self) -> bool:
        """True if the person here is a commander, and may take command at all."""
        try:
            return self._log.trust.person(self._signatory.name).role == "commander"
        except RefusedError:
            return False

    def prepare(self, started: SessionStarted | None) -> StationAuthority:
        """Return the keys of this station, which may command a session like the one joined.

        Raises ValueError that says why command cannot be taken from here.
        """
        log, name = self._log, self._signatory.name
        if not self.possible:
            raise ValueError(f"only a commander takes command, and {name} is none")
        if problem := log.link.problem:
            raise ValueError(f"no connection to the broker: {problem}")
        authority = self._own()
        if not authority.refusal:
            raise ValueError(
                f"{authority.name} is in command already; leave, and use 'console --fleet'"
            )
        if not authority.name:
            raise ValueError("this station is not in the roster: the owner of the site enrols it")
        if started is not None and started.rules_seal is not None:
            sha256 = started.rules_seal.content_sha256
            if sha256 not in authority.trust.roster.rules:
                raise ValueError(f"vehicles take nothing under the rules {started.rules!r}")
        self.authority = authority
        return authority

    def take(self, publish: Callable[[], object]) -> CommandTaken:
        """Take command now, let `publish` announce it, and return the log's first event.

        Raises ValueError when command cannot be taken; nothing has changed then.
        """
        authority, stream = self.authority, self._log.stream
        if authority is None:
            raise ValueError("nothing was prepared")
        authority.take_command(self._signatory.name, self._signatory.key)
        publish()
        self.last = tuple(self._log.take())
        self.taken = CommandTaken(
            station=stream.station,
            session=stream.session,
            records=stream.wanted - 1,
            head=stream.head,
            epoch=authority.trust.takeover.epoch,
            by=self._signatory.name,
        )
        return self.taken
