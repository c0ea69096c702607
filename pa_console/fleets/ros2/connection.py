"""The connection file of robots with ROS 2, and the fit of their map into the world."""

import cmath
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Self

from pydantic import Field, model_validator

from pa_console.fleets.ros2.messages import Planar
from pa_console.schema.base import Name, Point, Positive, StrictModel
from pa_console.schema.command import COMMANDS, Verb
from pa_console.schema.document import Document
from pa_console.schema.world import World

_MOVES: tuple[Verb, ...] = ("move_to", "observe", "block", "return_to_base")
"""The commands of a robot that only navigates to places and stays there."""

_NAME = r"^/?[A-Za-z0-9_]+(/[A-Za-z0-9_]+)*$"


class RobotEntry(StrictModel):
    """One robot; names that begin with `/` are absolute, other names are in its namespace."""

    namespace: str | None = Field(
        default=None, pattern=rf"^/?$|{_NAME}", description="by default, the asset's name"
    )
    can: tuple[Verb, ...] | None = Field(
        default=None,
        description="its commands besides hold and report; by default, going to places",
    )
    trees: dict[Verb, str] = Field(
        default={}, description="behaviour trees, files on the robot, for more than driving"
    )
    action: str = Field(default="navigate_to_pose", pattern=_NAME)
    stops: tuple[str, ...] = Field(
        default=("navigate_through_poses", "follow_waypoints"),
        description="further actions whose goals a hold cancels",
    )
    pose: Literal["tf", "odom", "amcl_pose"] = Field(
        default="tf", description="the source of its place; odom only if it is on the map"
    )
    tf: str = Field(default="tf", pattern=_NAME, description="/tf for robots that share it")
    odom: str = Field(default="odom", pattern=_NAME)
    map_frame: str = "map"
    base_frame: str = "base_link"
    battery: str | None = Field(
        default="battery_state", pattern=_NAME, description="null for a robot without a gauge"
    )
    nodes: tuple[str, ...] = Field(
        default=("amcl", "controller_server", "planner_server", "bt_navigator"),
        description="managed nodes that have to be active, if the robot has them",
    )
    manual: str | None = Field(
        default=None, pattern=_NAME, description="a std_msgs/Bool, true while a person steers"
    )
    clock: Literal["robot", "arrival"] = Field(
        default="robot",
        description="arrival for a robot on simulated time: reports are dated by their arrival",
    )

    @property
    def able(self) -> tuple[Verb, ...]:
        """The commands that the robot can carry out, besides hold and report."""
        return self.can if self.can is not None else _MOVES

    def named(self, asset: str, name: str) -> str:
        """Return the full ROS name of a topic or an action of the robot with the name `asset`."""
        space = (self.namespace if self.namespace is not None else asset).strip("/")
        return name if name.startswith("/") else f"/{space}/{name}" if space else f"/{name}"


class Connection(StrictModel):
    """The content of a connection file."""

    domain: int | None = Field(
        default=None, ge=0, le=232, description="ROS_DOMAIN_ID; by default, from the environment"
    )
    frames: dict[Name, Point] = Field(
        min_length=2, description="the places of the world's frames on the robots' map, metres"
    )
    off_by_m: Positive = Field(
        default=1.0, description="the largest distance between a frame on the map and in the world"
    )
    map: str | None = Field(
        default="/map",
        pattern=_NAME,
        description="a nav_msgs/OccupancyGrid on the robots' map, drawn by the console",
    )
    robots: dict[Name, RobotEntry] = Field(min_length=1, description="the robots, by asset")

    @model_validator(mode="after")
    def _actions_differ(self) -> Self:
        seen: dict[str, str] = {}
        for name, robot in self.robots.items():
            action = robot.named(name, robot.action)
            if action in seen:
                raise ValueError(
                    f"robots.{name}: {seen[action]} has the action {action} as well; give each "
                    "robot a namespace of its own"
                )
            seen[action] = name
        return self


@dataclass(frozen=True)
class RobotSite:
    """A world, the connection file of its robots, and the fit of their map into the world."""

    world: World
    connection: Connection
    fit: "MapFit"


def read_site(path: Path, world: World) -> RobotSite:
    """Return the contents of the connection file at `path`, for robots of `world`.

    Raises DocumentError with file, line, field and remedy if the file is not valid.
    """
    document = Document.read(path)
    connection = document.parse(Connection)
    for name in connection.frames:
        if name not in world.frames:
            frames = ", ".join(world.frames)
            raise document.error(("frames", name), f"not a frame of {world.name}; it has {frames}")
    for name, robot in connection.robots.items():
        if name not in world.assets:
            raise document.error(
                ("robots", name),
                f"not an asset of {world.name}; add it to the world file, or take it out here",
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
    """The place of the robots' map in the world, as a rotation and a translation.

    The map is not scaled, because the map and the world are in metres. A difference in scale is an
    error of measurement and appears as a distance in `worst`.
    """

    turn: float
    """The rotation of the map, counter-clockwise, in radians."""
    shift: Point
    """The world's coordinates of the map's origin."""
    worst: tuple[str, float]
    """The frame with the largest error of the fit, and that error in metres."""

    @classmethod
    def of(cls, on_map: dict[str, Point], in_world: dict[str, Point]) -> Self:
        """Return the best fit (least squares) of two or more frames, with places on both maps."""
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
        """Return the pose in the world of a pose on the map."""
        return Planar(*self.shift, self.turn).then(pose)

    def to_map(self, pose: Planar) -> Planar:
        """Return the pose on the map of a pose in the world."""
        x, y = pose.x - self.shift[0], pose.y - self.shift[1]
        back = Planar(0.0, 0.0, -self.turn)
        return back.then(Planar(x, y, math.remainder(pose.yaw, math.tau)))
