"""Joins a bus: connects to its broker, takes what is retained there, and names the new robots."""

import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from time import monotonic

from pa_console.fleets.link import FoundRobot
from pa_console.fleets.newcomers import with_robots
from pa_console.fleets.vda5050 import additions, messages
from pa_console.fleets.vda5050.additions import Countersignature, RecordsAsked, StopAsked
from pa_console.fleets.vda5050.broker import BrokerAddress, Credentials
from pa_console.fleets.vda5050.messages import Factsheet
from pa_console.fleets.vda5050.station_link import Delivery, StationLink
from pa_console.fleets.vda5050.wire import Identity
from pa_console.schema.command import COMMANDS
from pa_console.schema.world import AssetKind, World

TELEMETRY = (
    messages.RobotConnection,
    messages.RobotState,
    Factsheet,
    additions.Detections,
    additions.SiteDescription,
    additions.ClockDone,
    additions.IncidentDone,
    additions.ScenarioNews,
)
"""The messages of robots, cameras and a simulated site."""

FROM_PEOPLE = (*additions.SIGNED, RecordsAsked, Countersignature, StopAsked)
"""The messages of people: members and command of the site, requests of joined consoles."""

CONNECT_S = 5.0
RETAINED_S = 0.3
"""Retained messages are complete after this silence, seconds; live messages never end."""
MOST_RETAINED_S = 10.0
"""The longest wait for retained messages, seconds."""


@dataclass(frozen=True)
class JoinedBus:
    """A bus that was joined, with the retained messages found there."""

    link: StationLink
    site: additions.SiteDescription | None
    factsheets: dict[Identity, Factsheet]
    online: frozenset[Identity]
    """The identities that are connected."""
    deliveries: tuple[Delivery, ...]


def join(
    address: BrokerAddress,
    credentials: Credentials | None = None,
    telemetry: Credentials | None = None,
) -> JoinedBus:
    """Connect to the broker and receive the retained messages; raises ValueError without a broker.

    `telemetry` are the credentials of the connection that only receives.
    """
    link = StationLink(
        address, f"station-{secrets.token_hex(4)}", FROM_PEOPLE, credentials,
        telemetry=TELEMETRY, telemetry_as=telemetry,
    )  # fmt: skip
    if not link.wait_connected(CONNECT_S):
        problem = link.problem
        link.close()
        raise ValueError(f"no broker lets us in at {address}: {problem}")
    deliveries = take_retained(link)
    site: additions.SiteDescription | None = None
    factsheets: dict[Identity, Factsheet] = {}
    states: dict[Identity, messages.ConnectionState] = {}
    for delivery in deliveries:
        match delivery.message:
            case additions.SiteDescription() if delivery.topic.identity == additions.SITE:
                site = delivery.message
            case Factsheet():
                factsheets.setdefault(delivery.topic.identity, delivery.message)
            case messages.RobotConnection():
                states[delivery.topic.identity] = delivery.message.connection_state
            case _:
                pass
    online = frozenset(identity for identity, state in states.items() if state == "ONLINE")
    return JoinedBus(link, site, factsheets, online, tuple(deliveries))


def take_retained(link: StationLink) -> list[Delivery]:
    """Return what comes until all that is retained has come, live messages among it."""
    deliveries: list[Delivery] = []
    now = monotonic()
    end, quiet = now + MOST_RETAINED_S, now + RETAINED_S
    while (left := min(end, quiet) - monotonic()) > 0:
        link.wait_news(left)
        taken = link.take()
        deliveries += taken
        if any(delivery.retained for delivery in taken):
            quiet = monotonic() + RETAINED_S
    return deliveries


def with_newcomers(world: World, joined: JoinedBus) -> tuple[World, tuple[str, ...]]:
    """Return `world` with the robots that are on the bus and not in it, and a line about each.

    Each becomes an asset of the kind that its factsheet shows, with that kind's platform.
    """
    found = [
        FoundRobot(identity.serial_number, kind_of(sheet), detail=f"of {identity.manufacturer}")
        for identity, sheet in sorted(joined.factsheets.items())
        if identity in joined.online
    ]
    added, told = with_robots(world, found)
    if not added:
        return world, told
    return world.model_copy(update={"assets": {**world.assets, **added}}), told


def kind_of(sheet: Factsheet) -> AssetKind:
    """Return which kind of asset a robot is: as its class says, else by what it can do."""
    said = sheet.type_specification.mobile_robot_class.lower()
    named: Mapping[str, AssetKind] = {"uav": "uav", "ugv": "ugv", "robot": "robot"}
    if said in named:
        return named[said]
    special: tuple[AssetKind, ...] = ("uav", "ugv")
    for kind in special:
        alone = frozenset((kind,))
        if any(sheet.offers(verb) for verb, spec in COMMANDS.items() if spec.kinds == alone):
            return kind
    return "robot"
