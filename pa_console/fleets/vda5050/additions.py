"""The additions to the standard: detections, a simulated site, trust, and shared sessions.

Detections go to `<interface>/v3/<manufacturer>/<name>/detections`, from robots and from cameras. A
simulated site describes itself on `site`, as `pa-console`/`site`, and takes `incident` and `clock`.
The members of a site and the station in command are retained as `pa-console`/`trust`. A station
publishes the records of its log on `<interface>/v3/pa-console/<station>/records`; consoles that
have joined it send `recordsAsked`, `countersignature` and `stopAsked` to the same station.
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
"""The identity of signed messages: their signature counts, not their publisher."""

Metres = Annotated[float, Field(ge=0.0, le=1e5)]


class SeenContact(Wire):
    """One detection of a vehicle or person that is not ours.

    `signature` is the same for all detections of one contact. Without `x` and `y` the sensor only
    repeats earlier findings; `sigma_m` is the error of one axis, metres. `warned_s` is the time
    since the contact was warned.
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
        """Return it as the picture takes it in."""
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
    """A robot of the team that a sensor recognises, where it sees it."""

    name: Name
    x: Finite
    y: Finite


class Detections(Header):
    """The detections of one sensor; `works` is False for a camera that is out of order."""

    TOPIC: ClassVar[str] = "detections"
    works: bool = True
    contacts: Items[SeenContact] = Field(default=(), max_length=MOST_ITEMS)
    team: Items[SeenRobot] = Field(default=(), max_length=MOST_ITEMS)

    def report(self) -> SensorReport:
        """Return it as the picture takes it in."""
        return SensorReport(
            sensor=self.serial_number,
            sent=self.timestamp,
            contacts=[contact.report() for contact in self.contacts],
            team={robot.name: (robot.x, robot.y) for robot in self.team},
            works=self.works,
        )


class SiteDescription(Header):
    """The description of a simulated site: the hash of its world file, and its clock.

    With `paced` by the station it stands still until a `clock` message moves it on. `epoch` is when
    its clock began, and `rate` the number of its seconds that pass in one.
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

    `after` counts each robot's messages on its topics, so that none is overtaken. The site answers
    in the same way on `clockDone`, once it has sent everything.
    """

    TOPIC: ClassVar[str] = "clock"
    tick: Count
    after: dict[Id, Count] = {}


class ClockDone(ClockMessage):
    """The site has gone on to `tick`; `after` counts the messages of each robot and camera."""

    TOPIC: ClassVar[str] = "clockDone"


class IncidentMessage(Header):
    """The station lets something happen in a simulated site; `incident` is an Incident as JSON."""

    TOPIC: ClassVar[str] = "incident"
    number: Count
    incident: Text


class IncidentDone(Header):
    """The result of an incident; `problem` is why it could not happen, "" if it did."""

    TOPIC: ClassVar[str] = "incidentDone"
    number: Count
    problem: Text = ""
    after: dict[Id, Count] = {}


class ScenarioNews(Header):
    """An event of a site's scenario, or a skipped one, as JSON for the session log."""

    TOPIC: ClassVar[str] = "told"
    event: Text


class SignedMessage(Header):
    """A message signed by a member of the site, a JWT; retained, the newest of its kind."""

    message: Annotated[str, StringConstraints(max_length=65_536)]


class SignedRoster(SignedMessage):
    """The members of the site, signed by its owner."""

    TOPIC: ClassVar[str] = "roster"


class SignedRevocation(SignedMessage):
    """The revoked keys, signed by the owner of the site."""

    TOPIC: ClassVar[str] = "revocation"


class SignedTakeover(SignedMessage):
    """The station in command, signed by a commander."""

    TOPIC: ClassVar[str] = "takeover"


SIGNED: tuple[type[SignedMessage], ...] = (SignedRoster, SignedRevocation, SignedTakeover)
"""The signed messages, each after the ones that verify it."""

MOST_UNPACKED = 4 << 20
"""The largest size of the records in one message, bytes."""

_Packed = Annotated[str, StringConstraints(max_length=MOST_BYTES)]
_Signed = Annotated[str, StringConstraints(max_length=65_536)]


class SessionRecords(Header):
    """Records of a session log, one after another, for which the station vouches.

    `packed` are their lines, each with its end, as zlib data in base64. `signature` is a JWT by the
    station.
    """

    TOPIC: ClassVar[str] = "records"
    session: Id
    first: Count
    last: Count
    packed: _Packed
    signature: _Signed

    def lines(self) -> list[bytes]:
        """Return the lines without their ends; raises UnreadableError for what holds none."""
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
    """Return whole lines as `SessionRecords.packed`."""
    return base64.b64encode(zlib.compress(lines, 1)).decode()


class RecordsAsked(Header):
    """A joined console's request for the records of a session from `first` on."""

    TOPIC: ClassVar[str] = "recordsAsked"
    session: Id
    first: Count


class Countersignature(Header):
    """A second person approves the plan that waits at a station; `approval` is the signed JWT."""

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
