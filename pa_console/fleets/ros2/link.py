"""The link to robots that speak ROS 2: a Zenoh session, as client of a router or a bridge.

Everything that comes in waits in rings of Zenoh's own, so that a flood costs this process nothing
but the newest messages of one topic. `take` reads them on the station's thread, which is also the
only one that commands.
"""

import math
import secrets
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import partial
from typing import Any

import zenoh
from zenoh.ext import HistoryConfig, declare_advanced_subscriber

from pa_console.fleets.link import AssetReport, FoundRobot, LinkNews, LinkNotice
from pa_console.fleets.ros2 import messages
from pa_console.fleets.ros2.connection import (
    BridgeKeys,
    Connection,
    Keys,
    Layout,
    RmwKeys,
    RobotEntry,
    RobotSite,
    Ros2Address,
    Service,
    read_site,
)
from pa_console.fleets.ros2.localization import Localization
from pa_console.fleets.ros2.messages import Stamped, UnreadableError
from pa_console.fleets.ros2.navigator import Navigator, Seen, Then
from pa_console.schema.command import DeviceCommand
from pa_console.schema.document import DocumentError
from pa_console.schema.events.event import Level
from pa_console.schema.telemetry import AssetStatus
from pa_console.schema.world import World
from pa_console.settings.schema import Settings

OPEN_S = 5.0
"""The time that a router has to answer, seconds."""

LOOK_S = 2.0
"""The time that liveliness tokens have to come in, seconds."""

RING = 128
"""Messages of one topic that are kept between two looks; the oldest give way."""

NEWS_S = 0.02
"""The interval at which `wait` polls the rings, seconds."""

FLOOD_S = 0.25
"""A ring that fills up within this time is flooded, seconds; a busy topic takes longer."""

AHEAD_S = 2.0
"""A time so far in the future is of a wrong clock; localization stamps up to a second ahead."""

BEHIND_S = 60.0
"""A time so long ago is of a wrong clock, or of a simulation's, seconds."""

CHARGE_S = 5.0
"""A robot that has not reported its charge within this time, seconds, does not report it."""

QUIET_S = 10.0
"""The same notice of a robot is not repeated before this time, seconds."""

_PLACES = {"odom": "odom", "tf_static": "tf_static", "tf": "tf", "amcl_pose": "amcl_pose"}
"""Topics that give a place, by kind. They are read after all others, whose news a report has, and
`odom` first, because the speeds of places come from it."""

_KEPT = frozenset(("tf_static", "amcl_pose", "status"))
"""Topics published on a change only: the last value is asked for (durability transient local)."""


@dataclass
class _Robot:
    """One robot: what is known of it, and its topics."""

    name: str
    namespace: str
    entry: RobotEntry
    navigator: Navigator
    localization: Localization
    topics: dict[str, Any] = field(default_factory=dict[str, Any])
    """The subscription of each kind of message."""
    battery_pct: float | None = None
    seen_s: float = math.inf
    """When its place came in for the first time."""
    health: AssetStatus = "ok"
    reported_stamp: float = -math.inf
    told: dict[str, float] = field(default_factory=dict[str, float])
    """When each notice was given last."""


class Ros2Link:
    """Robots of a connection file; the address names the router and the file."""

    def __init__(
        self,
        session: zenoh.Session,
        address: Ros2Address,
        site: RobotSite,
        keys: Keys,
        *,
        clock: Callable[[], float] = time.monotonic,
        now: Callable[[], float] = time.time,
    ) -> None:
        """`clock` measures how long things take, seconds; `now` is the time of the robots (UTC)."""
        self.name = f"ros2:{address.locator} ({keys.layout})"
        self.agents = frozenset(site.connection.robots)
        self._session, self._keys, self._site = session, keys, site
        self._clock, self._now = clock, now
        self._period_s = site.world.telemetry_period_s
        self._news: list[LinkNews] = []
        self._replies: deque[tuple[Then, bytes | None]] = deque()
        self._arrived = threading.Event()
        self._requests, self._read_s = 0, -math.inf
        self._actions: set[str] = set()
        """The actions whose servers are there, with their namespaces."""
        self._robots = {
            name: self._robot(name, entry) for name, entry in site.connection.robots.items()
        }
        self._tokens = session.liveliness().declare_subscriber(
            keys.tokens, zenoh.handlers.RingChannel(4096), history=True
        )
        if address.exposed:
            self._say("warning", self.name, "commands travel without encryption: use tls/HOST:PORT")

    @property
    def problem(self) -> str:
        """The reason why there is no connection, '' while there is one."""
        if self._session.is_closed():
            return "the session is closed"
        return "" if self._session.info.transports() else "the router does not answer"

    @property
    def layout(self) -> Layout:
        """The layout of the robots' keys."""
        return self._keys.layout

    def send(self, command: DeviceCommand) -> None:
        """Send `command` to its robot; without a connection it is not sent."""
        if (robot := self._robots.get(command.agent)) is None or self.problem:
            return
        robot.navigator.send(command)
        self._collect_answers(robot)

    def take(self) -> Sequence[LinkNews]:
        """Return what came in since the last call."""
        self._work()
        news, self._news = self._news, []
        return news

    def wait(self, seconds: float) -> bool:
        """Wait until there is news, for `seconds` at most; return whether there is."""
        until_s = time.monotonic() + seconds
        while True:
            self._work()
            left_s = until_s - time.monotonic()
            if self._news or left_s <= 0:
                return bool(self._news)
            self._arrived.wait(min(NEWS_S, left_s))

    def discover(self) -> Sequence[FoundRobot]:
        """Return a robot for each action server that takes goals on this link."""
        self._read()
        named = {f"{r.namespace}/{r.entry.action}": r for r in self._robots.values()}
        found: list[FoundRobot] = []
        for action in sorted(self._actions):
            known = named.get(action)
            if known is None and not action.endswith("/navigate_to_pose"):
                continue
            name = known.name if known is not None else action.removesuffix("/navigate_to_pose")
            place = known.localization.place if known is not None else None
            at = self._site.fit.to_world(place.pose)[:2] if place is not None else None
            kind = self._site.world.assets[name].kind if known is not None else "robot"
            found.append(FoundRobot(name.replace("/", "_"), kind, at, f"ROS 2, /{action}"))
        return found

    def close(self) -> None:
        """End the session; the robots do what they do without a station."""
        self._session.close()

    def _work(self) -> None:
        """Process waiting messages and due requests."""
        self._arrived.clear()
        self._read()
        for robot in self._robots.values():
            if (seen := self._seen(robot)) is not None:
                robot.navigator.see_place(seen)
            robot.navigator.step()
            self._collect_answers(robot)

    # Topics

    def _robot(self, name: str, entry: RobotEntry) -> _Robot:
        """Return a robot whose topics are subscribed to."""
        namespace = entry.namespace or name
        robot = _Robot(
            name,
            namespace,
            entry,
            Navigator(
                name,
                self._site,
                partial(self._call, Service(namespace, entry.action, "")),
                clock=self._clock,
                now=self._now,
            ),
            Localization(entry.map_frame, entry.base_frame, entry.pose),
        )
        action = f"{entry.action}/_action"
        wanted = {"status": f"{action}/status", "feedback": f"{action}/feedback"}
        wanted["health"] = "diagnostics_toplevel_state"
        if entry.battery is not None:
            wanted["battery"] = entry.battery
        if entry.manual is not None:
            wanted["manual"] = entry.manual
        wanted |= _PLACES
        for kind, topic in wanted.items():
            key = self._keys.topic(namespace, topic, kind)
            if kind in _KEPT:
                history = HistoryConfig(detect_late_publishers=True)
                robot.topics[kind] = declare_advanced_subscriber(
                    self._session, key, zenoh.handlers.RingChannel(RING), history=history
                )
            else:
                robot.topics[kind] = self._session.declare_subscriber(
                    key, zenoh.handlers.RingChannel(RING)
                )
        return robot

    def _read(self) -> None:
        """Take in what waits: answers of services, tokens, and the topics of each robot."""
        while self._replies:
            then, reply = self._replies.popleft()
            then(reply)
        while (token := self._tokens.try_recv()) is not None:
            there = token.kind == zenoh.SampleKind.PUT
            action = self._keys.saw(str(token.key_expr), there=there)
            if action is not None:
                (self._actions.add if there else self._actions.discard)(action)
        now_s, now = self._clock(), self._now()
        for robot in self._robots.values():
            for kind, topic in robot.topics.items():
                count = 0
                while count < RING and (sample := topic.try_recv()) is not None:
                    count += 1
                    self._see(robot, kind, sample.payload.to_bytes(), (now_s, now))
                    if kind == robot.entry.pose:
                        self._report(robot, now_s)
                if count == RING and now_s - self._read_s < FLOOD_S:
                    text = f"sends so much on {kind} that some of it goes unread"
                    self._tell(robot, "alarm", text, f"flood {kind}")
        self._read_s = now_s

    def _see(self, robot: _Robot, kind: str, payload: bytes, at: tuple[float, float]) -> None:
        """Take in one message; one that cannot be read is reported, and changes nothing."""
        try:
            self._take_in(robot, kind, payload, at)
        except UnreadableError as error:
            self._tell(robot, "alarm", f"its message on {kind} is set aside: {error}", kind)

    def _take_in(self, robot: _Robot, kind: str, payload: bytes, at: tuple[float, float]) -> None:
        now_s, now = at
        stamped = partial(self._stamped, robot, now)
        match kind:
            case "tf":
                transforms = [stamped(each) for each in messages.read_transforms(payload)]
                robot.localization.see_transforms(transforms, now_s)
            case "tf_static":
                robot.localization.see_transforms(
                    messages.read_transforms(payload), now_s, fixed=True
                )
            case "odom":
                pose, speed_mps = messages.read_odometry(payload)
                robot.localization.see_odometry(stamped(pose), speed_mps, now_s)
            case "amcl_pose":
                pose = stamped(messages.read_localization(payload))
                robot.localization.see_localization(pose, now_s)
            case "battery":
                robot.battery_pct = messages.read_battery(payload)
            case "health":
                health, words = messages.read_health(payload)
                if health not in (robot.health, "ok"):
                    text = f"reports its condition as {health}: {words or 'without a reason'}"
                    self._tell(robot, "warning", text, health)
                robot.health = health
            case "manual":
                robot.navigator.manual = messages.read_flag(payload)
            case "status":
                robot.navigator.see_states(messages.read_goal_states(payload))
            case _:
                robot.navigator.see_feedback(messages.read_feedback(payload))

    def _stamped(self, robot: _Robot, now: float, pose: Stamped) -> Stamped:
        """Return `pose` with the time that it counts as, seconds (UTC)."""
        if robot.entry.clock == "arrival":
            return pose._replace(stamp=now)
        if pose.stamp - now > AHEAD_S:
            raise UnreadableError(f"its clock is {pose.stamp - now:.0f} s ahead of ours")
        if now - pose.stamp > BEHIND_S:
            text = "its clock is far behind ours; for simulated time set 'clock: arrival'"
            self._tell(robot, "alarm", text, "behind")
        return pose

    # Reports and answers

    def _seen(self, robot: _Robot) -> Seen | None:
        """Return where a robot is in the world, None while that is not known."""
        place = robot.localization.place
        if place is None:
            return None
        pose = self._site.fit.to_world(place.pose)
        speed_mps = robot.localization.speed(place.stamp)
        return Seen((pose.x, pose.y), pose.yaw, speed_mps, place.arrived_s)

    def _report(self, robot: _Robot, now_s: float) -> None:
        """Report where a robot is, every telemetry period or so of its own time."""
        place = robot.localization.place
        # A report that is a little early is one of the next period; to wait would skip that.
        if place is None or place.stamp - robot.reported_stamp < 0.9 * self._period_s:
            return
        seen = self._seen(robot)
        if seen is None:
            return
        battery_pct = robot.battery_pct if robot.entry.battery is not None else 100.0
        if battery_pct is None:
            robot.seen_s = min(robot.seen_s, now_s)
            if now_s - robot.seen_s < CHARGE_S:
                return
            text = (
                f"reports no charge on {robot.entry.battery}, so it is not shown; "
                "name its topic as 'battery', or 'battery: null' if it has no gauge"
            )
            self._tell(robot, "alarm", text, "no charge")
            return
        robot.reported_stamp = place.stamp
        failed = robot.health == "failed"
        self._news.append(
            AssetReport(
                agent=robot.name,
                sent=datetime.fromtimestamp(round(place.stamp, 3), UTC),
                position=seen.at,
                heading_deg=math.degrees(seen.heading_rad) % 360.0,
                speed_mps=seen.speed_mps,
                status=robot.health,
                task="none" if failed else robot.navigator.task,
                battery_pct=battery_pct,
                command_id=robot.navigator.command_id,
                manual=robot.navigator.manual,
            )
        )
        robot.navigator.reported(place.arrived_s)

    def _collect_answers(self, robot: _Robot) -> None:
        self._news += robot.navigator.take()
        for text in robot.navigator.problems:
            self._tell(robot, "warning", text, text.partition(":")[0])
        robot.navigator.problems.clear()

    def _tell(self, robot: _Robot, level: Level, text: str, about: str) -> None:
        """Give a notice about a robot; one about the same thing is given seldom."""
        now_s = self._clock()
        if now_s - robot.told.get(about, -math.inf) >= QUIET_S:
            robot.told[about] = now_s
            self._say(level, robot.name, text)

    def _say(self, level: Level, subject: str, text: str) -> None:
        self._news.append(LinkNotice(level, subject, text))

    # Services

    def _call(self, own: Service, name: str, request: bytes, limit_s: float, then: Then) -> bool:
        """Call a service of a robot; `then` gets the first answer, or None, when `take` is called.

        A hold goes before everything else that waits to be sent.
        """
        action, _, service = name.rpartition("/")
        key = self._keys.service(Service(own.namespace, action or own.action, service))
        if key is None:
            return False
        self._requests += 1
        urgent = service == "cancel_goal"
        answer = _Answer(self._replies, self._arrived, then)
        try:
            self._session.get(
                key,
                zenoh.handlers.Callback(answer.take, answer.end, indirect=False),
                payload=request,
                attachment=self._keys.attachment(self._requests, time.time_ns()),
                timeout=limit_s,
                priority=zenoh.Priority.REAL_TIME if urgent else None,
                congestion_control=zenoh.CongestionControl.DROP,
            )
        except zenoh.ZError:
            return False
        return True


class _Answer:
    """The first answer of a service, or none, for `then`; called on Zenoh's threads."""

    def __init__(
        self, replies: deque[tuple[Then, bytes | None]], arrived: threading.Event, then: Then
    ) -> None:
        self._replies, self._arrived = replies, arrived
        self._then: Then | None = then

    def take(self, reply: zenoh.Reply) -> None:
        """Take an answer."""
        if reply.ok is not None:
            self._give(reply.ok.payload.to_bytes())

    def end(self) -> None:
        """Note that no more answers come."""
        self._give(None)

    def _give(self, payload: bytes | None) -> None:
        then, self._then = self._then, None
        if then is not None:
            self._replies.append((then, payload))
            self._arrived.set()


def open_link(address: str, world: World, settings: Settings) -> Ros2Link:  # noqa: ARG001
    """Return the link at `tcp/HOST:PORT#FILE`, for the assets that the file names.

    Raises ValueError with the remedy for an address or a file that cannot be used, if nothing
    answers there, and if no layout is given and none can be seen.
    """
    where = Ros2Address.parse(address)
    try:
        site = read_site(where.robots, world)
    except DocumentError as error:
        raise ValueError(str(error)) from error
    session, keys = connect(where, site)
    return Ros2Link(session, where, site, keys)


def connect(where: Ros2Address, site: RobotSite) -> tuple[zenoh.Session, Keys]:
    """Return a session at `where`, and the keys of the robots; raises ValueError likewise."""
    connection = site.connection
    session = _open(where, connection)
    try:
        layout = connection.layout or _find_layout(session, where, connection)
        client = secrets.token_bytes(16)
        keys: Keys = BridgeKeys() if layout == "bridge" else RmwKeys(connection.domain, client)
        return session, keys
    except BaseException:
        session.close()
        raise


def _open(where: Ros2Address, connection: Connection) -> zenoh.Session:
    """Return a session that is a client of the router at `where` alone."""
    try:
        own = connection.zenoh
        config = zenoh.Config.from_file(own) if own is not None else zenoh.Config()
        for key, value in {
            "mode": '"client"',
            "connect/endpoints": f'["{where.locator}"]',
            "connect/timeout_ms": str(int(OPEN_S * 1000)),
            "connect/retry": '{"period_init_ms": 250, "period_max_ms": 1000}',
            "listen/endpoints": "[]",
            "scouting/multicast/enabled": "false",
            "transport/shared_memory/enabled": "false",
            # A burst of holds must find room: what does not within this time is dropped.
            "transport/link/tx/queue/size/real_time": "16",
            "transport/link/tx/queue/size/data": "16",
            "transport/link/tx/queue/congestion_control/drop/wait_before_drop": "20000",
        }.items():
            config.insert_json5(key, value)
        return zenoh.open(config)
    except zenoh.ZError as error:
        why = str(error).partition(" at /")[0]
        raise ValueError(
            f"ros2:{where.locator} cannot be reached: {why} Is a Zenoh router or "
            "zenoh-bridge-ros2dds running there?"
        ) from error


def _find_layout(session: zenoh.Session, where: Ros2Address, connection: Connection) -> Layout:
    """Return the layout whose liveliness tokens are there; raises ValueError for none or both."""
    found: list[Layout] = []
    layouts: tuple[tuple[Layout, str], ...] = (
        ("bridge", BridgeKeys.tokens),
        ("rmw", RmwKeys(connection.domain, b"").tokens),
    )
    for layout, tokens in layouts:
        if any(reply.ok is not None for reply in session.liveliness().get(tokens, timeout=LOOK_S)):
            found.append(layout)
    if len(found) == 1:
        return found[0]
    seen = "robots of both layouts" if found else "no robot that navigates"
    raise ValueError(
        f"ros2:{where.locator} shows {seen}: write 'layout: bridge' or 'layout: rmw' into "
        f"{where.robots}"
    )
