"""The survey of the robots on a message bus; it sends nothing."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime

from pa_console.fleets.link import FoundRobot, LinkFinding, LinkNews, LinkNotice
from pa_console.fleets.readiness import MessageWatch, NeededMessage, readiness_finding
from pa_console.fleets.reports import AHEAD_S, AssetReport
from pa_console.fleets.vda5050.additions import SITE, Detections
from pa_console.fleets.vda5050.asset_state import faults_of, telemetry_of
from pa_console.fleets.vda5050.gateway import offers
from pa_console.fleets.vda5050.messages import Factsheet, RobotConnection, RobotState
from pa_console.fleets.vda5050.station_link import Delivery, JoinedBus, kind_of, robots_on
from pa_console.fleets.vda5050.vehicle import PAUSE
from pa_console.fleets.vda5050.wire import VERSION, Header, Identity, UnreadableError
from pa_console.schema.world import AssetKind, World
from pa_console.sim.worlds.terrain import Terrain

EXAMINED = (RobotConnection, Factsheet, RobotState, Detections)
"""The kinds of messages of robots and cameras that are examined."""


def _needed(world: World, *, camera: bool) -> tuple[NeededMessage, ...]:
    """Return the messages that the console needs from a robot, or from a camera."""

    def periodic(message: type[Header], lacking: str) -> NeededMessage:
        return NeededMessage(message.TOPIC, world.stale_s, lacking, patience_s=world.stale_s)

    if camera:
        return (periodic(Detections, "it counts as broken, and its gate as not covered"),)
    return (
        NeededMessage(
            RobotConnection.TOPIC, 0.0, "only its silence shows that it is gone", source="retained"
        ),
        NeededMessage(
            Factsheet.TOPIC, 0.0, "it may get orders that it does not support", source="retained"
        ),
        periodic(RobotState, "its state is unknown, and it is not shown"),
    )


@dataclass
class _Sender:
    """One robot or camera on the bus, and its latest messages."""

    watch: MessageWatch
    connection: str = ""
    factsheet: Factsheet | None = None
    state: RobotState | None = None
    ahead_s: float = 0.0
    """The time of sending of its latest report minus the time of arrival, in seconds."""
    unreadable: dict[str, str] = field(default_factory=dict[str, str])
    """The latest error on each topic that had invalid messages."""

    def lacks(self) -> Iterator[str]:
        """Yield the reasons why the robot cannot start."""
        if self.connection not in ("", "ONLINE"):
            yield f"its connection is {self.connection}"
        if self.state is None:
            yield "it sends no state"
            return
        yield from faults_of(self.state)
        if self.state.manual:
            yield f"a person drives it ({self.state.operating_mode})"
        place = self.state.mobile_robot_position
        if place is None or not place.localized:
            yield "it does not know where it is"


class BusListener:
    """A joined bus, for a survey of the robots and cameras on it."""

    def __init__(self, world: World, joined: JoinedBus) -> None:
        self.name, self.agents = str(joined.link.address), frozenset(world.assets)
        self._joined, self._terrain, self._began = joined, Terrain(world), datetime.now(UTC)
        self._deliveries = joined.deliveries
        self._senders: dict[Identity, _Sender] = {}

    @property
    def problem(self) -> str:
        """The reason why there is no connection; '' while there is one."""
        return self._joined.link.problem

    def take(self) -> Sequence[LinkNews]:
        """Return the reports and notices since the last call, in order of arrival."""
        deliveries, self._deliveries = (*self._deliveries, *self._joined.link.take()), ()
        return [news for delivery in deliveries for news in self._take(delivery)]

    def wait(self, seconds: float) -> bool:
        """Wait at most `seconds` for a message; return whether one has arrived."""
        return self._joined.link.wait_news(seconds)

    def close(self) -> None:
        """Leave the bus."""
        self._joined.link.close()

    def discover(self) -> Sequence[FoundRobot]:
        """Return the robots that are connected and have a factsheet."""
        return robots_on(self._joined)

    def examine(self, seconds: float) -> Sequence[LinkFinding]:  # noqa: ARG002 - it has listened
        """Return findings about every robot and camera on the bus."""
        return [
            finding
            for identity, sender in sorted(self._senders.items())
            for finding in self._findings(identity, sender)
        ]

    def _take(self, delivery: Delivery) -> Iterator[LinkNews]:
        topic, message = delivery.topic, delivery.message
        name, world = topic.identity.serial_number, self._terrain.world
        if topic.name not in [kind.TOPIC for kind in EXAMINED] or topic.identity == SITE:
            return
        if topic.identity not in self._senders:
            if twin := next((i for i in self._senders if i.serial_number == name), None):
                makers = f"{twin.manufacturer} and {topic.identity.manufacturer}"
                text = f"is the name of two robots, of {makers}: only one is accepted"
                yield LinkNotice("alarm", name, text)
            needed = _needed(world, camera=name in world.cameras)
            watch = MessageWatch(needed, self._began.timestamp())
            self._senders[topic.identity] = _Sender(watch)
        sender = self._senders[topic.identity]
        if isinstance(message, UnreadableError):
            sender.unreadable[topic.name] = str(message)
            return
        if delivery.retained and isinstance(message, RobotState | Detections):
            sender.unreadable[topic.name] = "retained by the broker"
            return
        sender.watch.heard(topic.name, delivery.at.timestamp())
        match message:
            case RobotConnection():
                sender.connection = message.connection_state
            case Factsheet():
                sender.factsheet = message
            case RobotState():
                sender.state = message
                sender.ahead_s = (message.timestamp - delivery.at).total_seconds()
                kind = self._kind(topic.identity, sender)
                if telemetry := telemetry_of(message, name, kind, self._terrain, 0.0):
                    yield AssetReport(
                        name,
                        message.timestamp,
                        telemetry.position,
                        telemetry.heading_deg,
                        telemetry.speed_mps,
                        telemetry.status,
                        telemetry.task,
                        telemetry.battery_pct,
                        manual=telemetry.manual,
                    )
            case _:
                pass

    def _kind(self, identity: Identity, sender: _Sender) -> AssetKind:
        """Return the kind of a robot: from the world, else from its factsheet."""
        spec = self._terrain.world.assets.get(identity.serial_number)
        if spec is not None:
            return spec.kind
        return kind_of(sender.factsheet) if sender.factsheet is not None else "robot"

    def _findings(self, identity: Identity, sender: _Sender) -> Iterator[LinkFinding]:
        """Yield findings about a robot or a camera: readiness, messages, place, clock, orders."""
        name, world = identity.serial_number, self._terrain.world
        now_s = datetime.now(UTC).timestamp()
        if name not in world.cameras:
            yield readiness_finding(name, "; ".join(sender.lacks()))
        yield from sender.watch.findings(name, now_s)
        for topic, error in sender.unreadable.items():
            unread = LinkFinding(name, f"{topic}, not valid", error)
            yield unread.unless(False, f"VDA 5050 {VERSION}, not retained", "it is set aside")
        if (state := sender.state) is not None:
            if (place := state.mobile_robot_position) is not None:
                at = LinkFinding(name, "place", f"({place.x:.1f}, {place.y:.1f})")
                inside = self._terrain.depth((place.x, place.y)) >= 0.0
                wanted = f"inside the perimeter of {world.name}"
                yield at.unless(inside, wanted, "it is shown in a wrong place; its map differs")
            clock = LinkFinding(name, "clock", f"{sender.ahead_s:+.1f} s")
            exact = -world.stale_s < sender.ahead_s <= AHEAD_S
            yield clock.unless(exact, "correct to a second", "its reports are stale or set aside")
        if (sheet := sender.factsheet) is not None:
            verbs = sorted(offers(self._kind(identity, sender)) - {"hold"})
            offered = [verb for verb in verbs if sheet.offers(verb)]
            orders = LinkFinding(name, "orders offered", ", ".join(offered) or "none")
            yield orders.unless(offered, f"some of {', '.join(verbs)}", "each order is refused")
            stop = LinkFinding(name, PAUSE, "offered" if sheet.offers(PAUSE) else "not offered")
            yield stop.unless(sheet.offers(PAUSE), "offered", "a hold or STOP may not stop it")
