"""The bus clients of simulated assets and cameras, each with a last will of its own."""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from pa_console.fleets.bus.address import BrokerAddress, Credentials
from pa_console.fleets.bus.client import BusClient, Received, Sent
from pa_console.fleets.site.factsheets import factsheet_of, offers
from pa_console.fleets.vda5050.additions import MANUFACTURER, Detections
from pa_console.fleets.vda5050.asset_state import state_of
from pa_console.fleets.vda5050.messages import (
    Connection,
    ConnectionState,
    InstantActions,
    KnownZoneSet,
    Order,
    ZoneSet,
)
from pa_console.fleets.vda5050.numbers import Numbers
from pa_console.fleets.vda5050.topics import Identity, Topic
from pa_console.fleets.vda5050.vehicle import Vehicle, Verify
from pa_console.fleets.vda5050.wire import Header, UnreadableError
from pa_console.schema.command import CommandReply, DeviceCommand
from pa_console.schema.telemetry import AssetTelemetry
from pa_console.schema.world import AssetKind, World


@dataclass(frozen=True)
class OnBus:
    """The parts that all clients of a site share; `now` is the clock of the site (UTC).

    `credentials` returns the certificates of a client name.
    """

    address: BrokerAddress
    numbers: Numbers
    now: Callable[[], datetime]
    credentials: Callable[[str], Credentials | None]


class Speaker:
    """A client on the bus under a name of its own."""

    HEARS: tuple[type[Header], ...] = ()

    def __init__(self, name: str, bus: OnBus) -> None:
        self.identity, self._site = Identity(MANUFACTURER, name), bus.address.site
        self._numbers, self._now = bus.numbers, bus.now
        self.client = BusClient(
            bus.address,
            f"{bus.address.site}-{name}",
            self._heard,
            self._changed,
            [self._topic(kind.TOPIC) for kind in self.HEARS],
            self._will,
            bus.credentials(name),
        )

    def say(self, message: Header, *, qos: int = 0, retain: bool = False) -> None:
        """Publish `message`, if there is a connection."""
        self.client.send(Sent(self._topic(message.TOPIC), message.write(), qos, retain))

    def header(self, topic: str, sent: datetime | None = None) -> dict[str, Any]:
        """Return the header of the next message on `topic`, `sent` at that time or now."""
        return self._numbers.header(self.identity, topic, sent or self._now())

    def connection(self, state: ConnectionState) -> Connection:
        """Return the message that reports the connection's state."""
        return Connection(**self.header(Connection.TOPIC), connection_state=state)

    async def leave(self) -> None:
        """Report a departure in good order."""
        self.say(self.connection("OFFLINE"), qos=1, retain=True)
        await self.client.sent()

    def _arrived(self) -> None:
        """React to a connection."""

    def _take(self, message: Header) -> None:
        """Take in a message."""

    def _reject(self, topic: str, why: str) -> None:
        """React to a message that cannot be read."""

    def _topic(self, name: str) -> str:
        return str(Topic(self._site, self.identity, name))

    def _will(self) -> Sent:
        broken = self.connection("CONNECTION_BROKEN")
        return Sent(self._topic(Connection.TOPIC), broken.write(), qos=1, retain=True)

    def _changed(self, connected: bool, _why: str) -> None:
        if connected:
            self.say(self.connection("ONLINE"), qos=1, retain=True)
            self._arrived()

    def _heard(self, received: Received) -> None:
        topic = Topic.of(received.topic)
        kind = next((kind for kind in self.HEARS if topic and topic.name == kind.TOPIC), None)
        if kind is None or received.retained:
            return
        try:
            message = kind.read(received.payload)
        except UnreadableError as error:
            self._reject(kind.TOPIC, str(error))
            return
        self._numbers.saw(self.identity, kind.TOPIC, message.header_id)
        self._take(message)


class Gateway(Speaker):
    """The radio's end on the bus: it speaks for one asset, with what the asset itself has said.

    `forward` puts a command on the asset's radio link. A state never claims to be newer than the
    asset's last report.
    """

    HEARS = (Order, InstantActions, ZoneSet)

    def __init__(
        self,
        name: str,
        bus: OnBus,
        world: World,
        forward: Callable[[DeviceCommand], None],
        verify: Verify,
    ) -> None:
        super().__init__(name, bus)
        self._world = world
        self._kind: AssetKind = world.assets[name].kind
        self._forward = forward
        self.vehicle = Vehicle(self.identity, offers(self._kind), bus.now, verify, relays=True)
        self._zones: tuple[KnownZoneSet, ...] = ()
        self._said: tuple[AssetTelemetry, datetime] | None = None
        self._cut = False

    def report(self, said: AssetTelemetry, sent: datetime) -> None:
        """Publish the asset's own report, as of `sent`."""
        if self._said is not None and sent < self._said[1]:
            return
        self._said = (said, sent)
        if self._cut:
            self._cut = False
            self.say(self.connection("ONLINE"), qos=1, retain=True)
        self.tell()

    def cut(self) -> None:
        """Report the asset's link as long broken."""
        self._cut = True
        self.say(self.connection("CONNECTION_BROKEN"), qos=1, retain=True)

    def hear(self, reply: CommandReply) -> None:
        """Pass on what the asset answers."""
        self.vehicle.hear(reply)
        self.tell()

    def tell(self) -> None:
        """Publish the state, once the asset has ever reported."""
        if self._said is not None and self.client.connected:
            said, sent = self._said
            number = self.header("state", sent)["header_id"]
            self.say(state_of(said, self.vehicle, number, sent, self._zones))

    def _arrived(self) -> None:
        sheet = factsheet_of(self._kind, self._world, self.header("factsheet"))
        self.say(sheet, qos=1, retain=True)
        self.tell()

    def _take(self, message: Header) -> None:
        match message:
            case Order():
                commands = list(self.vehicle.take_order(message))
            case InstantActions():
                commands = list(self.vehicle.take_actions(message))
            case ZoneSet():
                zones = message.zone_set
                known = KnownZoneSet(
                    zone_set_id=zones.zone_set_id, map_id=zones.map_id, zone_set_status="ENABLED"
                )
                self._zones, commands = (known,), []
            case _:
                commands = []
        for command in commands:
            self._forward(command)
        self.tell()

    def _reject(self, topic: str, why: str) -> None:
        self.vehicle.reject(f"{topic}: {why}")
        self.tell()


class CameraSpeaker(Speaker):
    """Speaks for a camera, which has a wire."""

    def see(self, seen: Detections) -> None:
        """Publish what the camera sees now."""
        self.say(seen)
