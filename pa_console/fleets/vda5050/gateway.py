"""The bus clients of simulated assets and cameras."""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from pa_console.fleets.vda5050.additions import MANUFACTURER
from pa_console.fleets.vda5050.asset_state import state_of
from pa_console.fleets.vda5050.broker import (
    BrokerAddress,
    BusClient,
    Credentials,
    IncomingMessage,
    OutgoingMessage,
)
from pa_console.fleets.vda5050.messages import (
    REPLACES,
    ConnectionState,
    Factsheet,
    InstantActions,
    KnownZoneSet,
    OfferedAction,
    OptionalParameter,
    Order,
    ParameterSpecification,
    PhysicalParameters,
    ProtocolFeatures,
    ProtocolLimits,
    RobotConnection,
    Scope,
    Timing,
    TypeSpecification,
    ZoneSet,
)
from pa_console.fleets.vda5050.vehicle import (
    AUTHORIZATION,
    CANCEL,
    PAUSE,
    RESUME,
    TARGET,
    Vehicle,
    Verify,
)
from pa_console.fleets.vda5050.wire import Header, Identity, Numbers, Topic, UnreadableError
from pa_console.schema.command import COMMANDS, STILL, CommandReply, DeviceCommand, Verb
from pa_console.schema.telemetry import AssetTelemetry
from pa_console.schema.world import AssetKind, World

AT_ONCE: tuple[str, ...] = (PAUSE, RESUME, CANCEL, "report")
"""The instant actions that each simulated asset offers."""

ACCELERATION_MPS2 = 1.0
HEIGHT_M = 1.0


def offers(kind: AssetKind) -> frozenset[Verb]:
    """Return the verbs that an asset of `kind` can carry out."""
    return frozenset(verb for verb, spec in COMMANDS.items() if kind in spec.kinds)


def factsheet_of(kind: AssetKind, world: World, header: dict[str, Any]) -> Factsheet:
    """Return the factsheet of an asset of `kind` in `world`."""
    platform = world.platforms[kind]
    moves = tuple(
        _offered(verb, "NODE")
        for verb in COMMANDS
        if verb not in STILL and kind in COMMANDS[verb].kinds
    )
    at_once = tuple(_offered(action, "INSTANT") for action in AT_ONCE)
    return Factsheet(
        **header,
        type_specification=TypeSpecification(
            series_name=f"{world.name} {kind}",
            mobile_robot_kinematics="OMNIDIRECTIONAL" if kind == "uav" else "DIFFERENTIAL",
            mobile_robot_class=kind,
            maximum_load_mass=0.0,
            localization_types=("GNSS",),
            navigation_types=("AUTONOMOUS",),
            supported_zones=("BLOCKED",),
        ),
        physical_parameters=PhysicalParameters(
            minimum_speed=0.0,
            maximum_speed=platform.speed_mps,
            maximum_acceleration=ACCELERATION_MPS2,
            maximum_deceleration=ACCELERATION_MPS2,
            minimum_height=HEIGHT_M,
            maximum_height=HEIGHT_M,
            width=2 * platform.radius_m,
            length=2 * platform.radius_m,
        ),
        protocol_limits=ProtocolLimits(
            timing=Timing(
                minimum_order_interval=0.0,
                minimum_state_interval=world.dt_s,
                default_state_interval=world.telemetry_period_s,
            )
        ),
        protocol_features=ProtocolFeatures(
            optional_parameters=(OptionalParameter(parameter=REPLACES, support="SUPPORTED"),),
            mobile_robot_actions=(*moves, *at_once),
        ),
    )


def _offered(action: str, scope: Scope) -> OfferedAction:
    keys = (TARGET, AUTHORIZATION) if scope == "NODE" else ()
    return OfferedAction(
        action_type=action,
        action_scopes=(scope,),
        action_parameters=tuple(
            ParameterSpecification(key=key, value_data_type="STRING", is_optional=True)
            for key in keys
        ),
        pause_allowed=True,
        cancel_allowed=True,
    )


@dataclass(frozen=True)
class OnBus:
    """The parts that all clients of a site share.

    `now` is the clock of the site (UTC). `credentials` returns the credentials for a client name.
    """

    address: BrokerAddress
    numbers: Numbers
    now: Callable[[], datetime]
    credentials: Callable[[str], Credentials | None]


class Speaker:
    """A client on the bus with its own name and last will."""

    HEARS: tuple[type[Header], ...] = ()
    """The kinds of messages that the client receives."""

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
        self.client.send(OutgoingMessage(self._topic(message.TOPIC), message.write(), qos, retain))

    def header(self, topic: str, sent: datetime | None = None) -> dict[str, Any]:
        """Return the header of the next message on `topic`, with the time `sent` or now."""
        return self._numbers.header(self.identity, topic, sent or self._now())

    def connection(self, state: ConnectionState) -> RobotConnection:
        """Return the message about the state of the connection."""
        return RobotConnection(**self.header(RobotConnection.TOPIC), connection_state=state)

    async def leave(self) -> None:
        """Report the client as offline, and wait until the message is sent."""
        self.say(self.connection("OFFLINE"), qos=1, retain=True)
        await self.client.sent()

    def _arrived(self) -> None:
        """React to a new connection."""

    def _take(self, message: Header) -> None:
        """Process a message."""

    def _reject(self, topic: str, why: str) -> None:
        """React to a message that cannot be read."""

    def _topic(self, name: str) -> str:
        return str(Topic(self._site, self.identity, name))

    def _will(self) -> OutgoingMessage:
        broken = self.connection("CONNECTION_BROKEN")
        return OutgoingMessage(
            self._topic(RobotConnection.TOPIC), broken.write(), qos=1, retain=True
        )

    def _changed(self, connected: bool, _why: str) -> None:
        if connected:
            self.say(self.connection("ONLINE"), qos=1, retain=True)
            self._arrived()

    def _heard(self, received: IncomingMessage) -> None:
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
    """The bus client of one asset, to which it is connected by radio.

    `forward` sends a command over the radio link. The states on the bus come from the asset's own
    reports, and their time is that of the last report.
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
        self._last_report: tuple[AssetTelemetry, datetime] | None = None
        self._cut = False

    def report(self, telemetry: AssetTelemetry, sent: datetime) -> None:
        """Publish the asset's own report with the time `sent`, unless a newer one is known."""
        if self._last_report is not None and sent < self._last_report[1]:
            return
        self._last_report = (telemetry, sent)
        if self._cut:
            self._cut = False
            self.say(self.connection("ONLINE"), qos=1, retain=True)
        self.tell()

    def cut(self) -> None:
        """Report the asset's link as broken."""
        self._cut = True
        self.say(self.connection("CONNECTION_BROKEN"), qos=1, retain=True)

    def hear(self, reply: CommandReply) -> None:
        """Process a reply of the asset, and publish the state."""
        self.vehicle.hear(reply)
        self.tell()

    def tell(self) -> None:
        """Publish the state, if the asset has reported at least once."""
        if self._last_report is not None and self.client.connected:
            telemetry, sent = self._last_report
            number = self.header("state", sent)["header_id"]
            self.say(state_of(telemetry, self.vehicle, number, sent, self._zones))

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
                zone_set = KnownZoneSet(
                    zone_set_id=zones.zone_set_id, map_id=zones.map_id, zone_set_status="ENABLED"
                )
                self._zones, commands = (zone_set,), []
            case _:
                commands = []
        for command in commands:
            self._forward(command)
        self.tell()

    def _reject(self, topic: str, why: str) -> None:
        self.vehicle.reject(f"{topic}: {why}")
        self.tell()
