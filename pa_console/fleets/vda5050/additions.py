"""The console's additions to the standard: detections, simulated sites, trust and shared sessions.

Robots and cameras publish detections on `<interface>/v3/<manufacturer>/<name>/detections`. A
simulated site has the identity `pa-console`/`site`; it publishes its description on `site` and
receives `incident` and `clock`. The roster, the revoked keys and the takeover are retained under
the identity `pa-console`/`trust`. A station publishes the records of its log on
`<interface>/v3/pa-console/<station>/records`. Joined consoles send `recordsAsked`,
`countersignature` and `stopAsked` to the same station.
"""

import base64
import binascii
import zlib
from typing import Annotated, ClassVar, Literal

from pydantic import Field, StringConstraints

from pa_console.fleets.reports import ContactReport, SensorReport
from pa_console.fleets.vda5050.wire import (
    MOST_BYTES,
    MOST_ITEMS,
    Count,
    Finite,
    Header,
    Id,
    Identity,
    Items,
    Text,
    UnreadableError,
    Wire,
)
from pa_console.schema.base import Name
from pa_console.schema.telemetry import Identity as ContactIdentity
from pa_console.schema.telemetry import Intent, Weather

MANUFACTURER = "pa-console"
SITE = Identity(MANUFACTURER, "site")
TRUST = Identity(MANUFACTURER, "trust")
"""The identity of signed messages, which are trusted by signature, not by publisher."""

MOST_UNPACKED = 4 << 20
"""The largest size of the records in one message, in bytes."""

Metres = Annotated[float, Field(ge=0.0, le=1e5)]
_Packed = Annotated[str, StringConstraints(max_length=MOST_BYTES)]
_Signed = Annotated[str, StringConstraints(max_length=65_536)]


class SeenContact(Wire):
    """One detection of a vehicle or person outside the team.

    `signature` is the same in all detections of one contact. Without `x` and `y`, the sensor only
    repeats earlier findings. `sigma_m` is the standard deviation along one axis, in metres.
    `warned_s` is the time since the contact was warned, in seconds.
    """

    signature: Id
    kind: Literal["vehicle", "person"]
    x: Finite | None = None
    y: Finite | None = None
    sigma_m: Metres
    identity: ContactIdentity = "unknown"
    opinion: Intent = "unknown"
    noncombatants: bool = False
    emergency: bool = False
    warned_s: Metres | None = None

    def report(self) -> ContactReport:
        """Return the detection in the form that the picture processes."""
        return ContactReport(
            signature=self.signature,
            kind=self.kind,
            position=None if self.x is None or self.y is None else (self.x, self.y),
            sigma_m=self.sigma_m,
            identity=self.identity,
            opinion=self.opinion,
            noncombatants=self.noncombatants,
            warned_s=self.warned_s,
            emergency=self.emergency,
        )


class SeenRobot(Wire):
    """A robot of the team that a sensor recognises, with its observed position."""

    name: Name
    x: Finite
    y: Finite


class Detections(Header):
    """The detections of one sensor; `works` is False if it is a camera out of order."""

    TOPIC: ClassVar[str] = "detections"
    works: bool = True
    contacts: Items[SeenContact] = Field(default=(), max_length=MOST_ITEMS)
    team: Items[SeenRobot] = Field(default=(), max_length=MOST_ITEMS)

    def report(self) -> SensorReport:
        """Return the detections in the form that the picture processes."""
        return SensorReport(
            sensor=self.serial_number,
            sent=self.timestamp,
            contacts=[contact.report() for contact in self.contacts],
            team={robot.name: (robot.x, robot.y) for robot in self.team},
            works=self.works,
        )


class SiteDescription(Header):
    """The description of a simulated site: the hash of its world file, and its clock.

    A `paced` site advances only when a `clock` message of the station allows it. `rate` is the
    number of seconds that pass at the site in one real second.
    """

    TOPIC: ClassVar[str] = "site"
    world: Name
    world_sha256: Id
    seed: int
    scenario: Id = ""
    paced: bool = False
    rate: Annotated[float, Field(gt=0.0, le=1000.0)] = 1.0
    tick: Count = 0
    weather: Weather = "clear"


class ClockMessage(Header):
    """The permission for a paced site to advance to `tick`, after the messages in `after`.

    `after` has the number of the last message on each topic of a robot, so that the site can wait
    for delayed messages. Once the site has sent everything, it answers in the same form on
    `clockDone`.
    """

    TOPIC: ClassVar[str] = "clock"
    tick: Count
    after: dict[Id, Count] = {}


class ClockDone(ClockMessage):
    """The confirmation that the site has advanced to `tick`.

    `after` has the number of the last message on each topic of a robot or camera.
    """

    TOPIC: ClassVar[str] = "clockDone"


class IncidentMessage(Header):
    """The station's request for an incident at a simulated site, with the Incident as JSON."""

    TOPIC: ClassVar[str] = "incident"
    number: Count
    incident: Text


class IncidentDone(Header):
    """The result of an incident; `problem` is the reason if it could not happen, else ""."""

    TOPIC: ClassVar[str] = "incidentDone"
    number: Count
    problem: Text = ""
    after: dict[Id, Count] = {}


class ScenarioNews(Header):
    """An event of a site's scenario, or a notice of a skipped one, as JSON for the session log."""

    TOPIC: ClassVar[str] = "told"
    event: Text


class SignedMessage(Header):
    """A JWT signed by a member of the site; the bus retains the newest of each kind."""

    message: Annotated[str, StringConstraints(max_length=65_536)]


class SignedRoster(SignedMessage):
    """The members of the site, signed by its owner."""

    TOPIC: ClassVar[str] = "roster"


class SignedRevocation(SignedMessage):
    """The revoked keys, signed by the site's owner."""

    TOPIC: ClassVar[str] = "revocation"


class SignedTakeover(SignedMessage):
    """The station in command, signed by a commander."""

    TOPIC: ClassVar[str] = "takeover"


SIGNED: tuple[type[SignedMessage], ...] = (SignedRoster, SignedRevocation, SignedTakeover)
"""The kinds of signed messages, each after the kinds that are needed to verify it."""


class SessionRecords(Header):
    """Consecutive records of a session log, confirmed by the station's signature.

    `packed` is their lines with line ends, as zlib data in base64. `signature` is a JWT of the
    station.
    """

    TOPIC: ClassVar[str] = "records"
    session: Id
    first: Count
    last: Count
    packed: _Packed
    signature: _Signed

    def lines(self) -> list[bytes]:
        """Return the lines without line ends; raises UnreadableError if `packed` is not valid."""
        unpacking = zlib.decompressobj()
        try:
            lines = unpacking.decompress(
                base64.b64decode(self.packed, validate=True), MOST_UNPACKED
            )
        except (zlib.error, binascii.Error, ValueError) as error:
            raise UnreadableError(f"its records cannot be unpacked: {error}") from None
        if not unpacking.eof or not lines.endswith(b"\n"):
            raise UnreadableError("its records are incomplete or too many")
        return lines[:-1].split(b"\n")


def pack(lines: bytes) -> str:
    """Return complete lines in the form of `SessionRecords.packed`."""
    return base64.b64encode(zlib.compress(lines, 1)).decode()


class RecordsAsked(Header):
    """A joined console's request for the records of a session from `first` on."""

    TOPIC: ClassVar[str] = "recordsAsked"
    session: Id
    first: Count


class Countersignature(Header):
    """A second person's approval of the plan that waits at a station, a signed JWT."""

    TOPIC: ClassVar[str] = "countersignature"
    session: Id
    request_id: Id
    person: Id
    approval: _Signed


class StopAsked(Header):
    """A joined console's request for a stop of all assets; a stop needs no signature."""

    TOPIC: ClassVar[str] = "stopAsked"
    session: Id
    person: Id
