"""The connection file of a link's robots, and the Zenoh keys of their topics and services.

The YAML file in the address, `ros2:tcp/HOST:PORT#FILE`, has the robots, their abilities, and the
position of their map. Behind zenoh-bridge-ros2dds a key is the ROS name with the bridge's namespace
in front. On rmw_zenoh it is `DOMAIN/NAME/TYPE/HASH`; types and hashes of services depend on the
release, so they are read from the liveliness tokens `@ros2_lv/...` that every ROS node declares. A
service of rmw_zenoh takes no request without an attachment: sequence number, time, and the id of
the client.
"""

import cmath
import math
import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Literal, NamedTuple, Protocol, Self

from pydantic import Field, model_validator

from pa_console.fleets.ros2.messages import Planar
from pa_console.schema.base import Name, Point, Positive, StrictModel
from pa_console.schema.command import COMMANDS, Verb
from pa_console.schema.document import Document
from pa_console.schema.world import World

Layout = Literal["bridge", "rmw"]
"""The keys of robots behind zenoh-bridge-ros2dds, and of robots on rmw_zenoh."""

_MOVES: tuple[Verb, ...] = ("move_to", "observe", "block", "return_to_base")
"""The commands of a robot that only navigates: going to a place, and staying there."""

_LOCATOR = re.compile(r"(tcp|tls|quic|udp|ws|unixsock-stream|serial|vsock)/\S+")
_TOPIC = r"^[A-Za-z0-9_~]+(/[A-Za-z0-9_~]+)*$"
_OWN_MACHINE = re.compile(r"(127\.|localhost\b|\[::1\])")


class RobotEntry(StrictModel):
    """One robot; every name is as ROS 2 has it, without the namespace in front."""

    namespace: str | None = Field(
        default=None, pattern=_TOPIC, description="in front of its names; its asset by default"
    )
    can: tuple[Verb, ...] | None = Field(
        default=None,
        description="what it is able to do; going to places if left out, hold and report always",
    )
    trees: dict[Verb, str] = Field(
        default={}, description="behaviour trees, files on the robot, for what is not only driving"
    )
    action: str = Field(default="navigate_to_pose", pattern=_TOPIC)
    stops: tuple[str, ...] = Field(
        default=("navigate_through_poses", "follow_waypoints"),
        description="further actions whose goals a hold cancels",
    )
    pose: Literal["tf", "odom", "amcl_pose"] = Field(
        default="tf", description="where its place is read; odom only if that is the map"
    )
    map_frame: str = "map"
    base_frame: str = "base_link"
    battery: str | None = Field(
        default="battery_state", pattern=_TOPIC, description="null for a robot without a gauge"
    )
    manual: str | None = Field(
        default=None,
        pattern=_TOPIC,
        description="a std_msgs/Bool that is true while a person steers",
    )
    clock: Literal["robot", "arrival"] = Field(
        default="robot",
        description="arrival for a robot on simulated time: a report is then of when it came",
    )

    @property
    def able(self) -> tuple[Verb, ...]:
        """Its abilities, besides hold and report."""
        return self.can if self.can is not None else _MOVES


class Connection(StrictModel):
    """The content of a connection file."""

    layout: Layout | None = Field(default=None, description="looked for at the start if left out")
    domain: int = Field(default=0, ge=0, le=232, description="ROS_DOMAIN_ID, for the rmw layout")
    frames: dict[Name, Point] = Field(
        min_length=2, description="where the robots' map has frames of the world, metres"
    )
    off_by_m: Positive = Field(
        default=1.0, description="the map may put a frame this far from where the world has it"
    )
    robots: dict[Name, RobotEntry] = Field(min_length=1, description="the robots, by asset")
    zenoh: str | None = Field(
        default=None, description="a Zenoh configuration (JSON5), for certificates and access"
    )

    @model_validator(mode="after")
    def _namespaces_differ(self) -> Self:
        seen: dict[str, str] = {}
        for name, robot in self.robots.items():
            space = robot.namespace or name
            if space in seen:
                raise ValueError(
                    f"robots.{name}.namespace: {seen[space]} has the namespace {space!r} as well"
                )
            seen[space] = name
        return self


@dataclass(frozen=True)
class Ros2Address:
    """An address: the locator of a Zenoh router or bridge, and the connection file."""

    locator: str
    robots: Path

    @classmethod
    def parse(cls, address: str) -> Self:
        """Return the parts of `tcp/HOST:PORT#FILE`; raises ValueError with the remedy."""
        locator, _, name = address.rpartition("#")
        if not locator or not name:
            raise ValueError(
                f"ros2:{address}: name the connection file after the locator: "
                f"ros2:{locator or name or 'tcp/HOST:PORT'}#FILE (see 'pa-console manual ros2')"
            )
        if _LOCATOR.fullmatch(locator) is None:
            raise ValueError(
                f"ros2:{address}: {locator!r} is no Zenoh locator; write tcp/HOST:PORT or "
                "tls/HOST:PORT, such as ros2:tcp/127.0.0.1:7447#robots.yaml"
            )
        return cls(locator, Path(name))

    @property
    def exposed(self) -> bool:
        """True if commands leave this machine without encryption."""
        kind, _, host = self.locator.partition("/")
        return kind in ("tcp", "udp", "ws") and _OWN_MACHINE.match(host) is None


@dataclass(frozen=True)
class RobotSite:
    """A world, the robots of it that a connection file names, and where their map lies."""

    world: World
    connection: Connection
    fit: "MapFit"


def read_site(path: Path, world: World) -> RobotSite:
    """Return the contents of the connection file at `path`, for robots of `world`.

    Raises DocumentError, which names file, line, field and remedy.
    """
    document = Document.read(path)
    connection = document.parse(Connection)
    for name in connection.frames:
        if name not in world.frames:
            known = ", ".join(world.frames)
            raise document.error(("frames", name), f"no frame of {world.name}; it has {known}")
    for name, robot in connection.robots.items():
        if name not in world.assets:
            raise document.error(
                ("robots", name),
                f"no asset of {world.name}; add it to the world file, or take it out here",
            )
        kind = world.assets[name].kind
        for verb in robot.trees:
            if verb not in robot.able:
                problem = f"{name} has a behaviour tree for {verb}; add {verb} to 'can'"
                raise document.error(("robots", name, "trees", verb), problem)
        for place, verb in enumerate(robot.can or ()):
            if kind not in COMMANDS[verb].kinds:
                problem = f"a {kind} cannot {verb} by the rules of the console; take it out"
                raise document.error(("robots", name, "can", place), problem)
    fit = MapFit.of(connection.frames, {f: world.frames[f].at for f in connection.frames})
    name, off_m = fit.worst
    if off_m > connection.off_by_m:
        problem = (
            f"the map does not fit the world: {name} is {off_m:.1f} m off, more than off_by_m "
            f"({connection.off_by_m:g} m) allows; measure the frames again"
        )
        raise document.error(("frames", name), problem)
    return RobotSite(world, connection, fit)


@dataclass(frozen=True)
class MapFit:
    """The place of the robots' map in the world: turned and moved, never stretched or mirrored.

    Both are in metres, so a scale is an error of measurement, and shows as one.
    """

    turn: float
    """Radians by which the map is turned, counter-clockwise."""
    shift: Point
    """The world's coordinates of the map's origin."""
    worst: tuple[str, float]
    """The frame that is farthest from its place, and how far that is, metres."""

    @classmethod
    def of(cls, on_map: dict[str, Point], in_world: dict[str, Point]) -> Self:
        """Return the best fit (least squares) of the same frames, two or more, in both."""
        there = {name: complex(*at) for name, at in on_map.items()}
        here = {name: complex(*in_world[name]) for name in on_map}
        middle = sum(there.values()) / len(there)
        target = sum(here.values()) / len(here)
        turned = sum((here[name] - target) * (there[name] - middle).conjugate() for name in on_map)
        turn = math.atan2(turned.imag, turned.real)
        shift = target - cmath.rect(1.0, turn) * middle
        off = {
            name: abs(cmath.rect(1.0, turn) * there[name] + shift - here[name]) for name in on_map
        }
        name = max(off, key=lambda each: off[each])
        return cls(turn, (shift.real, shift.imag), (name, off[name]))

    def to_world(self, pose: Planar) -> Planar:
        """Return a pose on the map in the world."""
        return Planar(*self.shift, self.turn).then(pose)

    def to_map(self, pose: Planar) -> Planar:
        """Return a pose in the world on the map."""
        x, y = pose.x - self.shift[0], pose.y - self.shift[1]
        back = Planar(0.0, 0.0, -self.turn)
        return back.then(Planar(x, y, math.remainder(pose.yaw, math.tau)))


SERVICES = ("send_goal", "cancel_goal", "get_result")
"""The services of an action."""

_TYPES: Mapping[str, str] = MappingProxyType(
    {
        "tf": "tf2_msgs::msg::dds_::TFMessage_",
        "tf_static": "tf2_msgs::msg::dds_::TFMessage_",
        "odom": "nav_msgs::msg::dds_::Odometry_",
        "amcl_pose": "geometry_msgs::msg::dds_::PoseWithCovarianceStamped_",
        "battery": "sensor_msgs::msg::dds_::BatteryState_",
        "health": "diagnostic_msgs::msg::dds_::DiagnosticStatus_",
        "manual": "std_msgs::msg::dds_::Bool_",
        "status": "action_msgs::msg::dds_::GoalStatusArray_",
        "feedback": "nav2_msgs::action::dds_::NavigateToPose_FeedbackMessage_",
    }
)
"""The types of subscriptions, as rmw_zenoh writes them."""


class Service(NamedTuple):
    """A service of an action of a robot: `name` is one of SERVICES."""

    namespace: str
    action: str
    name: str


class Keys(Protocol):
    """One layout of keys."""

    layout: Layout
    tokens: str
    """The key expression of the liveliness tokens of action servers."""

    def topic(self, namespace: str, name: str, kind: str) -> str:
        """Return the key expression of a topic; `kind` is its type."""
        ...

    def service(self, service: Service) -> str | None:
        """Return the key of a service, None while it is not known to be there."""
        ...

    def saw(self, token: str, *, there: bool) -> str | None:
        """Take in a token that has come or gone; return the action that takes goals by it."""
        ...

    def attachment(self, number: int, time_ns: int) -> bytes | None:
        """Return what goes with the request `number` at a time (UTC), None for nothing."""
        ...


class BridgeKeys:
    """Robots behind zenoh-bridge-ros2dds, each with its namespace in its own bridge."""

    layout: Layout = "bridge"

    tokens = "@/*/@ros2_lv/AS/*/*"

    def topic(self, namespace: str, name: str, kind: str) -> str:  # noqa: ARG002
        """Return the key of a topic."""
        return f"{namespace}/{name}"

    def service(self, service: Service) -> str | None:
        """Return the key of a service; without a robot behind it, there is no answer."""
        return f"{service.namespace}/{service.action}/_action/{service.name}"

    def saw(self, token: str, *, there: bool) -> str | None:  # noqa: ARG002
        """Return the action whose server has come or gone."""
        return token.split("/")[4].replace("§", "/")

    def attachment(self, number: int, time_ns: int) -> bytes | None:  # noqa: ARG002
        """Return None: the bridge numbers requests itself."""
        return None


class RmwKeys:
    """Robots whose ROS 2 runs on rmw_zenoh."""

    layout: Layout = "rmw"

    def __init__(self, domain: int, client: bytes) -> None:
        """`client` is the id of this client, 16 bytes."""
        self._domain, self._client = domain, client
        self.tokens = f"@ros2_lv/{domain}/*/*/*/SS/*/*/*/$*%_action%$*/*/*/**"
        self._there: dict[str, dict[str, str]] = {}
        """Name of a service -> its keys, by token: while a robot starts again it may have two."""

    def topic(self, namespace: str, name: str, kind: str) -> str:
        """Return the key expression of a topic, whatever release its type is of."""
        return f"{self._domain}/{namespace}/{name}/{_TYPES[kind]}/*"

    def service(self, service: Service) -> str | None:
        """Return the key of a service, None until its token has come."""
        name = f"{service.namespace}/{service.action}/_action/{service.name}"
        return next(reversed(self._there.get(name, {}).values()), None)

    def saw(self, token: str, *, there: bool) -> str | None:
        """Take in the token of a service; return the action of one that takes goals."""
        parts = token.split("/")
        name, type_name, type_hash = (part.replace("%", "/") for part in parts[9:12])
        name = name.strip("/")
        keys = self._there.setdefault(name, {})
        if there:
            keys[token] = f"{self._domain}/{name}/{type_name}/{type_hash}"
        else:
            keys.pop(token, None)
        end = "/_action/send_goal"
        return name.removesuffix(end) if name.endswith(end) else None

    def attachment(self, number: int, time_ns: int) -> bytes | None:
        """Return two numbers of 8 bytes, and the length and bytes of the client's id."""
        return struct.pack("<qqB", number, time_ns, len(self._client)) + self._client
