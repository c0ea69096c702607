"""The fleet on an MQTT broker, in which each robot is a VDA 5050 vehicle.

The clock is the station's. A report is dated by its own time, but never later than its arrival. A
report from the future, or from before the last one, is discarded.
"""

import secrets
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from pydantic import TypeAdapter, ValidationError

from pa_console.fleets.fleet import PlanCountersignature, Received
from pa_console.fleets.reported_fleet import ReportedFleet
from pa_console.fleets.reported_picture import ReportedPicture
from pa_console.fleets.vda5050 import additions, commands, messages
from pa_console.fleets.vda5050.additions import Countersignature, RecordsAsked, StopAsked
from pa_console.fleets.vda5050.asset_state import telemetry_of
from pa_console.fleets.vda5050.broker import OutgoingMessage
from pa_console.fleets.vda5050.commands import Robot
from pa_console.fleets.vda5050.messages import Factsheet
from pa_console.fleets.vda5050.sharing import SharedSession, signed_messages
from pa_console.fleets.vda5050.station_link import Delivery, JoinedBus
from pa_console.fleets.vda5050.vehicle import EXPIRY_S, STATE_REQUEST
from pa_console.fleets.vda5050.wire import Header, Identity, Numbers, Topic, UnreadableError
from pa_console.schema.command import DeviceCommand
from pa_console.schema.events.event import IncidentHappened, Noticed
from pa_console.schema.world import World
from pa_console.sim import picture as station_side

if TYPE_CHECKING:
    from pa_console.fleets.station_authority import StationAuthority

RETAIN_AGAIN_S = 1.0
"""The least time between replacements of older signed messages on the bus, in seconds."""
SUBJECT, KEYS_SUBJECT = "bus", "keys"
_HAPPENED: TypeAdapter[IncidentHappened | Noticed] = TypeAdapter(IncidentHappened | Noticed)


class MqttFleet(ReportedFleet):
    """The fleet of the robots of one site; with `keys`, commands are sent with tokens.

    With `keys`, the fleet also publishes its newest roster, revocation and takeover for the robots,
    and accepts newer ones from other stations.
    """

    def __init__(
        self, world: World, joined: JoinedBus, keys: "StationAuthority | None" = None
    ) -> None:
        super().__init__(ReportedPicture(world))
        self._elsewhere: Mapping[str, str] = {}
        """For each asset on another link, the name of that link."""
        self._link, self._keys = joined.link, keys
        self._rate = joined.site.rate if joined.site is not None else 1.0
        self._period = station_side.period_ticks(world)
        self._robots: dict[str, Robot] = {}
        self._numbers, self._signed_numbers = Numbers(), Numbers()
        self._session, self._asked_states = secrets.token_hex(8), 0
        """The prefix of every action id of this connection, which no other sender can guess."""
        self._dropped = 0
        self._shared: SharedSession | None = None
        self._countersigned: list[PlanCountersignature] = []
        self._stop_asked = ""
        self._published_s, self._older_there = 0.0, False
        self._published: set[str] = set()
        """The messages that this station has retained itself, which the broker sends back."""
        if joined.site is not None:
            self._weather = joined.site.weather
        self._connected, self._ready = True, False
        self._start = self._read_at = self.now()
        for delivery in joined.deliveries:
            self._take_or_set_aside(delivery)
        self._ready = True
        self._request_states()
        self.publish_signed()
        self._show()

    @property
    def reported(self) -> ReportedPicture:
        """The picture with the reports of this fleet; other links may add their reports."""
        return self._reported

    @property
    def name(self) -> str:
        """The address of the bus, which is the name of the fleet on the screen."""
        return str(self._link.address)

    @property
    def joined(self) -> frozenset[str]:
        """The assets that have joined the bus."""
        return frozenset(self._robots)

    def reserve(self, elsewhere: Mapping[str, str]) -> None:
        """Refuse robots on the bus that have the name of an asset in `elsewhere`, on another link.

        Raises ValueError if such a robot has already joined the bus.
        """
        if twice := sorted(self.joined & elsewhere.keys()):
            name, other = twice[0], elsewhere[twice[0]]
            raise ValueError(
                f"{name} is on two links, {self.name} and {other}: take it off one of them"
            )
        self._elsewhere = elsewhere

    @property
    def rate(self) -> float:
        """The number of seconds that pass on the robots' clock in one real second."""
        return self._rate

    @property
    def paced(self) -> bool:
        """True if the robots wait for the station's steps, which only simulated ones do."""
        return False

    def now(self) -> datetime:
        """Return the time on the robots' clock (UTC)."""
        return datetime.now(UTC)

    def send(self, command: DeviceCommand) -> None:
        """Send `command` to its robot now; without a connection, it is dropped.

        A command that the robot's factsheet excludes is refused here. A command to a robot that has
        never joined is not sent, so it never gets an answer.
        """
        robot = self._robots.get(command.agent)
        if robot is None:
            self._say("alarm", command.agent, "has not joined: nothing can be sent to it", "absent")
            return
        if why := robot.cannot(command):
            self._reply(command, "refused", why)
            return
        on_wire = command.model_copy(update={"command_id": f"{self._session}.{command.command_id}"})
        robot.ask(on_wire.command_id, command)
        robot.waiting = None
        if commands.is_order(on_wire):
            self._order(robot, on_wire)
        else:
            token = None if command.verb == "hold" else self._token(on_wire)
            robot.held = robot.held or command.verb == "hold"
            self._send(robot, self._at_once(robot, *commands.actions_at_once(on_wire, token)))

    def step(self) -> Received:
        """Advance the clock by `world.dt_s`; return everything received since the last step."""
        self._tick += 1
        self._look_after_link()
        self._receive()
        if self._older_there and self.time_s - self._published_s >= RETAIN_AGAIN_S:
            self.publish_signed()
        if self._tick % self._period == 0:
            self._show()
        self._share()
        replies, self._replies = tuple(self._replies), []
        countersigned, self._countersigned = tuple(self._countersigned), []
        stop_asked, self._stop_asked = self._stop_asked, ""
        return Received(replies, self._notices.take(), countersigned, stop_asked)

    def share(self, session: SharedSession) -> None:
        """Publish the records of a session from now on, and accept countersignatures for it."""
        self._shared = session

    def wait(self, seconds: float) -> bool:
        """Wait at most `seconds` for a message; return whether one has arrived."""
        return self._link.wait_news(seconds)

    def _token(self, command: DeviceCommand) -> str | None:
        return self._keys.authorize(command) if self._keys is not None else None

    def _receive(self) -> None:
        """Process all new messages; the clock is read once, for the lag and for all ages."""
        self._read_at = self.now()
        passed_s = (self._read_at - self._start).total_seconds() * self._rate
        self._reported.advance(self._tick, 0.0 if self.paced else passed_s - self.time_s)
        for delivery in self._link.take():
            self._take_or_set_aside(delivery)

    def _take_or_set_aside(self, delivery: Delivery) -> None:
        """Process one message; report an error as a notice, so that no message ends the session."""
        try:
            self._take(delivery)
        except Exception as error:
            name, topic = delivery.topic.identity.serial_number, delivery.topic.name
            text = f"its message on {topic!r} is set aside: {type(error).__name__}: {error}"
            self._say("alarm", name, text, f"fault {topic}")

    def close(self) -> None:
        """Leave the bus; the robots then follow their own rules for a lost link."""
        self._share()
        self._link.close()

    def _order(self, robot: Robot, command: DeviceCommand) -> None:
        """Send an order; first end the robot's pause, or cancel its current order, if necessary.

        The id of `command` is its id on the bus.
        """
        replaces = robot.factsheet is not None and robot.factsheet.replaces_orders
        if robot.busy and not replaces and not self._has_order(robot, command):
            robot.waiting = command
            self._send(robot, self._at_once(robot, commands.cancel_before(command)))
            return
        out: list[Header] = []
        paused = robot.state is not None and robot.state.paused
        if robot.held or paused:
            out.append(self._at_once(robot, commands.resume_for(command)))
        place = robot.state.mobile_robot_position if robot.state is not None else None
        nodes, edges = commands.order_of(
            command,
            self.world,
            (place.x, place.y) if place is not None else None,
            robot.state.last_node_id if robot.state is not None else "",
            self._token(command),
        )
        header = self._header(robot.identity, messages.Order.TOPIC)
        order = messages.Order(
            **header, order_id=command.command_id, order_update_id=0, nodes=nodes, edges=edges
        )
        out.append(order)
        if self._send(robot, *out):
            robot.held = False

    @staticmethod
    def _has_order(robot: Robot, command: DeviceCommand) -> bool:
        return robot.state is not None and robot.state.order_id == command.command_id

    def _at_once(self, robot: Robot, *actions: messages.RobotAction) -> messages.InstantActions:
        header = self._header(robot.identity, messages.InstantActions.TOPIC)
        return messages.InstantActions(**header, actions=actions)

    def _header(self, identity: Identity, topic: str) -> dict[str, Any]:
        """Return the header of the next message on a topic."""
        return self._numbers.header(identity, topic, self.now())

    def _send(self, robot: Robot, *out: Header) -> bool:
        """Send messages to `robot` in order; return whether there was a connection."""
        sent = [
            OutgoingMessage(
                str(Topic(self._link.address.site, robot.identity, message.TOPIC)),
                message.write(),
                qos=1,
                expiry_s=round(EXPIRY_S),
            )
            for message in out
        ]
        if self._link.publish(*sent):
            return True
        why = f"nothing reaches the broker: {self._link.problem}"
        self._say("alarm", SUBJECT, why, "unsent")
        return False

    def _look_after_link(self) -> None:
        """Report a lost or restored connection, and messages that were dropped."""
        problem, dropped = self._link.problem, self._link.dropped
        if bool(problem) == self._connected:
            self._connected = not problem
            if problem:
                self._say("alarm", SUBJECT, f"no connection to the broker: {problem}", "down")
            else:
                self._say("info", SUBJECT, "connected to the broker again", "up")
                self._request_states()
                self.publish_signed()
        for sender, count in self._link.take_flooded().items():
            text = f"floods the bus: {count} messages were set aside unread"
            self._say("alarm", sender.serial_number, text, "flood")
        if dropped > self._dropped:
            text = f"{dropped - self._dropped} messages came too fast and were dropped"
            self._dropped = dropped
            self._say("alarm", SUBJECT, text, "flood")

    def _request_states(self) -> None:
        """Request the state of every robot, and send it the zones again."""
        for robot in self._robots.values():
            self._welcome(robot)

    def _welcome(self, robot: Robot) -> None:
        self._asked_states += 1
        request = messages.RobotAction(
            action_id=f"{self._session}.state{self._asked_states}",
            action_type=STATE_REQUEST,
            blocking_type="NONE",
        )
        zones = zone_set(self.world, self._header(robot.identity, messages.ZoneSet.TOPIC))
        self._send(robot, zones, self._at_once(robot, request))

    @property
    def connected(self) -> bool:
        """True while there is a connection to the broker."""
        return not self._link.problem

    def publish_signed(self) -> None:
        """Retain the newest signed messages on the bus, where they may be missing or outdated."""
        self._published_s, self._older_there = self.time_s, False
        if self._keys is not None:
            site, newest = self._link.address.site, self._keys.newest
            self._published |= set(newest.values())
            self._link.publish(*signed_messages(site, newest, self._signed_numbers, self.now()))

    def _take_signed(self, message: additions.SignedMessage) -> None:
        """Process a signed message; report a change of this station's right to command."""
        if self._keys is None:
            return
        before = self._keys.refusal
        why, refusal = self._keys.take(message.message), self._keys.refusal
        self._older_there |= bool(why)
        if why and self._ready and message.message not in self._published:
            text = f"a signed {message.TOPIC} changes nothing: {why}"
            self._say("warning", KEYS_SUBJECT, text, message.TOPIC)
        if refusal and refusal != before:
            self._say("alarm", KEYS_SUBJECT, f"this station sends no commands: {refusal}")
        elif before and not refusal:
            self._say("info", KEYS_SUBJECT, "this station is in command")

    def _share(self) -> None:
        """Publish the new and the requested records of the session."""
        if self._shared is not None:
            self._link.publish(*self._shared.step(self._link.address.site, self.now()))

    def _shares(self, station: Identity) -> bool:
        """Return whether `station` is this one and its session is shared."""
        return self._shared is not None and self._shared.identity == station

    def _take_countersignature(self, message: Countersignature) -> None:
        """Store a countersignature if the person may approve and it is for this session."""
        request, person, signature = message.request_id, message.person, message.approval
        if self._keys is None:
            return
        if why := self._keys.objection_to(request, person, signature):
            text = f"a signature from another station does not count: {why}"
            self._say("warning", KEYS_SUBJECT, text, "countersignature")
            return
        self._countersigned.append(PlanCountersignature(request, person, signature))

    def _take(self, delivery: Delivery) -> None:
        """Process one message; an invalid or implausible one is reported and otherwise ignored."""
        topic, message = delivery.topic, delivery.message
        name = topic.identity.serial_number
        if isinstance(message, UnreadableError):
            text = f"its message on {topic.name!r} cannot be read: {message}"
            self._say("alarm", name, text, f"unreadable {topic.name}")
            return
        self._numbers.saw(topic.identity, topic.name, message.header_id)
        match message:
            case messages.RobotConnection():
                self._take_connection(topic.identity, message)
            case Factsheet():
                if (robot := self._robot(topic.identity)) is not None:
                    robot.factsheet = message
            case messages.RobotState():
                self._take_state(delivery, message)
            case additions.Detections():
                self._take_detections(delivery, message)
            case additions.SiteDescription() if topic.identity == additions.SITE:
                self._weather = message.weather
            case additions.ScenarioNews() if topic.identity == additions.SITE:
                self._take_scenario_news(message)
            case additions.SignedMessage() if topic.identity == additions.TRUST:
                self._take_signed(message)
            case RecordsAsked() if self._shares(topic.identity):
                if self._shared is not None:
                    self._shared.ask(message)
            case Countersignature() if self._shares(topic.identity):
                self._take_countersignature(message)
            case StopAsked() if self._shares(topic.identity):
                if self._shared is not None and message.session == self._shared.session:
                    self._stop_asked = f"{message.person} at another station"
            case RecordsAsked() | Countersignature() | StopAsked():
                pass
            case _:
                self._take_more(topic.identity, message)

    def _take_more(self, identity: Identity, message: Header) -> None:
        """Report a message that its sender may not send; subclasses accept a site's messages."""
        self._say("alarm", identity.serial_number, f"sends {message.TOPIC!r}, which is not its own")

    def _take_scenario_news(self, message: additions.ScenarioNews) -> None:
        try:
            self._notices.add(_HAPPENED.validate_json(message.event))
        except ValidationError:
            self._say("alarm", additions.SITE.serial_number, "sends an event of an unknown kind")

    def _robot(self, identity: Identity) -> Robot | None:
        """Return the robot with this identity; None if there is no such asset on this bus.

        A robot that appears for the first time joins the fleet.
        """
        name = identity.serial_number
        if (other := self._elsewhere.get(name)) is not None:
            self._say("alarm", name, f"joins the bus, but is commanded over {other}: ignored")
            return None
        robot = self._robots.get(name)
        if robot is not None and robot.identity != identity:
            text = f"a second robot, of {identity.manufacturer}, has this name: ignored"
            self._say("alarm", name, text)
            return None
        if robot is None and name in self.world.assets:
            robot = self._robots[name] = Robot(identity)
            if self._ready:
                self._welcome(robot)
        elif robot is None and name not in self.world.cameras:
            text = "has joined; it can be commanded from the next session on"
            self._say("warning", name, text, "stranger")
        return robot

    def _take_connection(self, identity: Identity, message: messages.RobotConnection) -> None:
        if identity.serial_number in self.world.cameras or identity == additions.SITE:
            return
        robot = self._robot(identity)
        if robot is None:
            return
        before, robot.connection = robot.connection, message.connection_state
        if robot.connection != "ONLINE":
            self._reported.break_link(robot.name)
            if before == "ONLINE":
                word = robot.connection.lower().replace("_", " ")
                self._say(
                    "warning",
                    robot.name,
                    f"reports that it is {word}"
                    if word != "connection broken"
                    else "its connection is broken",
                    word,
                )
        elif before != "ONLINE" and self._ready:
            self._welcome(robot)

    def _take_state(self, delivery: Delivery, state: messages.RobotState) -> None:
        robot = self._robot(delivery.topic.identity)
        if robot is None:
            return
        stamp = self._stamp(delivery, state, robot.name)
        if stamp is None:
            return
        if not self._belief.is_latest(robot.name, state.timestamp):
            return
        for command, answer in robot.answers(state):
            self._reply(command, answer.status, answer.detail)
        if robot.waiting is not None and not robot.busy:
            command, robot.waiting = robot.waiting, None
            self._order(robot, command)
        kind = self.world.assets[robot.name].kind
        terrain = self._reported.terrain
        telemetry = telemetry_of(state, robot.name, kind, terrain, terrain.seconds(max(stamp, 0)))
        if telemetry is None:
            self._say("alarm", robot.name, "does not know where it is", "lost")
            return
        own = robot.command_id(telemetry.command_id)
        self._reported.report(robot.name, stamp, telemetry.model_copy(update={"command_id": own}))

    def _take_detections(self, delivery: Delivery, seen: additions.Detections) -> None:
        name = delivery.topic.identity.serial_number
        if name not in self.world.cameras:
            robot = self._robot(delivery.topic.identity)
            if robot is None:
                return
        stamp = self._stamp(delivery, seen, name)
        if stamp is not None:
            self._take_sensor(stamp, seen.report(), self._rate)

    def _stamp(self, delivery: Delivery, message: Header, name: str) -> int | None:
        """Return the tick at which a report was sent; None if retained or in the future."""
        if delivery.retained:
            text = f"its {message.TOPIC} was retained by the broker: it is not current"
            self._say("warning", name, text, f"retained {message.TOPIC}")
            return None
        stamp = self._tick_of(message.timestamp, delivery.at)
        if stamp is None:
            self._belief.ahead(name)
        return stamp

    def _tick_of(self, sent: datetime, arrived: datetime) -> int | None:
        """Return the tick on the station's clock at the time `sent`; None if in the future."""
        return self._belief.tick_of(sent, arrived, self._read_at, self._tick, self._rate)


def zone_set(world: World, header: dict[str, Any]) -> messages.ZoneSet:
    """Return the message with the restricted zones of `world`, which no robot may enter."""
    zones = tuple(
        messages.VdaZone(
            zone_id=name,
            zone_type="BLOCKED",
            vertices=tuple(messages.ControlPoint(x=x, y=y) for x, y in zone.polygon),
        )
        for name, zone in world.zones.items()
    )
    return messages.ZoneSet(
        **header, zone_set=messages.Zones(zone_set_id=f"{world.name}-restricted", zones=zones)
    )
