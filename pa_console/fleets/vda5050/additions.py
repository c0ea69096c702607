"""The additions to the standard: detections of sensors, and messages of a simulated site.

Detections go to `<interface>/v3/<manufacturer>/<name>/detections`, from robots and from cameras. A
simulated site describes itself on `site`, as `pa-console`/`site`, and takes `incident` and `clock`.
The members of a site and the station in command are retained as `pa-console`/`trust`.
"""

from typing import Annotated, ClassVar, Literal

from pydantic import Field, StringConstraints

from pa_console.fleets.vda5050.topics import Identity
from pa_console.fleets.vda5050.wire import MOST_ITEMS, Count, Finite, Header, Id, Items, Text, Wire
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

    `signature` tells detections of the same contact apart from others. Without `x` and `y` the
    sensor only repeats what it has found out before; `sigma_m` is the error of one axis, metres.
    `warned_s` is how many seconds ago the contact was warned.
    """

    signature: Id
    kind: Literal["vehicle", "person"]
    x: Finite | None = None
    y: Finite | None = None
    sigma_m: Metres
    identity: ContactIdentity = "unknown"
    opinion: Intent = "unknown"
    noncombatants: bool = False
    warned_s: Metres | None = None


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
    """The station lets a paced site go on to `tick`; `after` names what it has sent before.

    Per robot, `after` is the sum of its messages on the topics that it hears, so that none is
    overtaken. The site answers likewise on `clockDone`, once it has told everything.
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


class Told(Header):
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
"""The signed messages, each after those that it is checked by."""
