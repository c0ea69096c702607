"""The checkpoint as data, in metres: frames, walls, lanes, zones, platforms and assets."""

import re
from math import atan2, degrees, floor, hypot
from typing import Annotated, Literal, Self, get_args

from pydantic import Field, StringConstraints, field_validator, model_validator

from pa_console.network_address import server_address
from pa_console.schema.base import Name, NonNegative, Percent, Point, Positive, StrictModel

AssetKind = Literal["uav", "ugv", "robot"]
KINDS: tuple[AssetKind, ...] = get_args(AssetKind)
PLAIN_KINDS: dict[AssetKind, str] = {"uav": "drone", "ugv": "vehicle", "robot": "robot"}
"""The plain names of the asset kinds, which are also used in prompts."""
LostLink = Literal["hold", "return_to_base"]
MOST_POINTS = 100
"""The largest number of points of a line or a polygon."""
MOST_CORNERS = 1000
"""The limit on the total number of corners of perimeter, zones and walls, around which routes are
planned. A wall has four corners."""

OCCUPIED_CELL, FREE_CELL, UNKNOWN_CELL = "#", ".", "?"
"""The characters for the cells of a background."""

MOST_ROWS = 400
"""The largest number of rows and of columns of a background."""

_IMAGE_TOPIC = r"ros2:(/[A-Za-z0-9_]+)+"
"""The form of the address of an image that is published on a ROS 2 topic."""

MOST_ALIASES = 200


class Frame(StrictModel):
    """A named position that commands can refer to (paper, Section IV-A; WF-08, CAP-06)."""

    kind: Literal["gate", "post", "base"]
    at: Point
    radius_m: Positive = Field(
        default=8.0, description="distance within which an asset is at the frame"
    )


class Wall(StrictModel):
    """A straight wall that ground vehicles cannot cross."""

    start: Point
    end: Point
    thickness_m: Positive = 1.0


class Lane(StrictModel):
    """A road outside the perimeter that leads to a gate; its points begin at the far end."""

    gate: Name
    points: tuple[Point, ...] = Field(min_length=2, max_length=MOST_POINTS)


class Zone(StrictModel):
    """A polygon that assets may enter only because of a verified threat (ROE-07)."""

    kind: Literal["restricted"]
    polygon: tuple[Point, ...] = Field(min_length=3, max_length=MOST_POINTS)


class Sensing(StrictModel):
    """A sensor that scans for vehicles and persons once every telemetry period.

    A contact within range, field of view and line of sight is detected with the probability
    `detection_probability`. The measured position has a normal error with the standard deviation
    `position_noise_m` per axis.
    """

    sensor_range_m: Positive
    field_of_view_deg: float = Field(default=360.0, gt=0.0, le=360.0)
    detection_probability: float = Field(default=0.95, ge=0.0, le=1.0)
    position_noise_m: NonNegative = 0.5


class Camera(Sensing):
    """A fixed camera that watches the approach to a gate, and whose view walls block."""

    gate: Name
    at: Point
    heading_deg: float = Field(
        description="direction of the middle of its field of view; 0 east, 90 north"
    )
    snapshot: str | None = Field(
        default=None,
        max_length=500,
        exclude_if=lambda url: url is None,
        description="address of its image: http://10.0.0.7/snapshot.jpg, rtsp://, or ros2:/TOPIC",
    )

    @field_validator("snapshot")
    @classmethod
    def _is_address(cls, url: str | None) -> str | None:
        if url is not None and re.fullmatch(_IMAGE_TOPIC, url) is None:
            form = "http://HOST[:PORT]/PATH, https://, rtsp://, or ros2:/TOPIC"
            server_address(url, {"http": 80, "https": 443, "rtsp": 554}, "a camera", form)
        return url

    @property
    def image_topic(self) -> str:
        """The ROS 2 topic of its image, a `sensor_msgs/CompressedImage`; '' without a topic."""
        scheme, _, topic = (self.snapshot or "").partition(":")
        return topic if scheme == "ros2" else ""

    def covers(self, point: Point) -> bool:
        """Return whether a point is within range and field of view, without regard to walls."""
        dx, dy = point[0] - self.at[0], point[1] - self.at[1]
        off = (degrees(atan2(dy, dx)) - self.heading_deg + 180.0) % 360.0 - 180.0
        near = hypot(dx, dy) <= self.sensor_range_m
        return near and abs(off) <= self.field_of_view_deg / 2.0


class Radio(StrictModel):
    """The undisturbed link between the station and every asset.

    A message takes `latency_s` plus up to `jitter_s`, and is lost with the probability `loss`.
    """

    latency_s: NonNegative = 0.05
    jitter_s: NonNegative = 0.05
    loss: float = Field(default=0.0, ge=0.0, lt=1.0)


class Platform(Sensing):
    """The physical abilities of one kind of asset, and its behaviour after link loss (CAP-05)."""

    speed_mps: Positive
    turn_rate_dps: Positive
    radius_m: Positive
    lost_link: LostLink = "hold"
    lost_link_after_s: Positive = 10.0
    drain_idle_pct_per_min: NonNegative
    drain_moving_pct_per_min: NonNegative
    charge_pct_per_min: NonNegative = Field(
        default=10.0, description="charging at the base after a return"
    )


class AssetSpec(StrictModel):
    """One asset of the team, and the frame at which it is posted at the start."""

    kind: AssetKind
    post: Name
    battery_pct: Percent = 100.0


class Origin(StrictModel):
    """The geographic position of a world's point (0, 0), in WGS-84."""

    latitude: float = Field(ge=-90.0, le=90.0, description="degrees north of the equator")
    longitude: float = Field(ge=-180.0, le=180.0, description="degrees east of Greenwich")
    bearing: float = Field(
        default=0.0,
        ge=0.0,
        lt=360.0,
        description="direction of the y axis, in degrees clockwise from true north",
    )
    altitude: float | None = Field(
        default=None,
        ge=-500.0,
        le=9000.0,
        description="height of the ground above the ellipsoid, in metres; None if unknown",
    )


class Background(StrictModel):
    """A robot's map as the background of a world; it is only drawn and blocks no route."""

    origin: Point = Field(description="the lower left corner, in metres")
    cell_m: Positive = Field(description="the side of a cell, in metres")
    rows: tuple[Annotated[str, Field(pattern=r"^[#.?]+$", max_length=MOST_ROWS)], ...] = Field(
        min_length=1,
        max_length=MOST_ROWS,
        description="# for occupied, . for free, ? for unknown; the first row is farthest north",
    )

    @property
    def size_m(self) -> tuple[float, float]:
        """The size to the east and to the north, in metres."""
        return len(self.rows[0]) * self.cell_m, len(self.rows) * self.cell_m

    def is_occupied(self, point: Point) -> bool:
        """Return whether the cell at a point, given in metres, is occupied."""
        column = floor((point[0] - self.origin[0]) / self.cell_m)
        row = len(self.rows) - 1 - floor((point[1] - self.origin[1]) / self.cell_m)
        inside = 0 <= row < len(self.rows) and 0 <= column < len(self.rows[0])
        return inside and self.rows[row][column] == OCCUPIED_CELL

    @model_validator(mode="after")
    def _is_even(self) -> Self:
        if len({len(row) for row in self.rows}) > 1:
            raise ValueError("rows: all rows must have the same length")
        return self


Alias = Annotated[str, StringConstraints(pattern=r"^[a-z0-9]+( [a-z0-9]+){0,3}$", max_length=40)]
"""A local name: one to four words in lower case, without an article."""


class World(StrictModel):
    """All properties of a checkpoint that do not change during a simulation."""

    name: Name
    title: str
    origin: Origin | None = None
    dt_s: Positive = Field(default=0.1, le=0.5, description="fixed simulation step")
    telemetry_period_s: Positive = 0.5
    standoff_m: Positive = Field(description="least distance to an unverified track (ROE-04)")
    coverage_grace_s: Positive = Field(description="how long a gate may be uncovered (WF-03)")
    low_battery_pct: Percent = 25.0
    low_battery_policy: str = Field(
        default="",
        max_length=500,
        exclude_if=lambda text: not text,
        description="the words of the standing order that a console offers at its start",
    )
    stale_s: Positive = Field(default=3.0, description="age from which values count as unknown")
    link_lost_s: Positive = Field(
        default=6.0, description="silence after which a link counts as lost"
    )
    radio: Radio = Radio()
    perimeter: tuple[Point, ...] = Field(min_length=3, max_length=MOST_POINTS)
    walls: tuple[Wall, ...] = Field(default=(), max_length=200)
    frames: dict[Name, Frame] = Field(max_length=150)
    lanes: dict[Name, Lane] = Field(default={}, max_length=150)
    zones: dict[Name, Zone] = Field(default={}, max_length=100)
    cameras: dict[Name, Camera] = Field(default={}, max_length=150)
    background: Background | None = Field(default=None, exclude_if=lambda it: it is None)
    platforms: dict[AssetKind, Platform]
    assets: dict[Name, AssetSpec] = Field(max_length=2000)
    aliases: dict[Alias, Name] = Field(
        default={},
        max_length=MOST_ALIASES,
        exclude_if=lambda names: not names,
        description="local names of assets and places, such as {yard: Checkpoint}",
    )

    @property
    def gates(self) -> tuple[str, ...]:
        """The names of the gate frames, in file order."""
        return tuple(name for name, frame in self.frames.items() if frame.kind == "gate")

    @property
    def base(self) -> str:
        """The name of the frame to which `return_to_base` leads."""
        return next(name for name, frame in self.frames.items() if frame.kind == "base")

    @model_validator(mode="after")
    def _references_exist(self) -> Self:
        if not self.gates:
            raise ValueError("frames: at least one frame must have kind 'gate'")
        if sum(frame.kind == "base" for frame in self.frames.values()) != 1:
            raise ValueError("frames: exactly one frame must have kind 'base'")
        if not self.assets:
            raise ValueError("assets: at least one asset is needed")
        zones = sum(len(zone.polygon) for zone in self.zones.values())
        if len(self.perimeter) + zones + 4 * len(self.walls) > MOST_CORNERS:
            raise ValueError(
                f"perimeter, zones and walls: more than {MOST_CORNERS} corners together, "
                "counting four per wall; draw fewer"
            )
        if sum(len(lane.points) for lane in self.lanes.values()) > MOST_CORNERS:
            raise ValueError(f"lanes: more than {MOST_CORNERS} points together; draw fewer")
        names = {*self.frames, *self.zones, *self.assets}
        for alias, name in self.aliases.items():
            if name not in names:
                raise ValueError(f"aliases.{alias}: {name!r} is neither an asset nor a place")
            if alias.replace(" ", "") in {other.lower() for other in names}:
                raise ValueError(f"aliases.{alias}: an asset or a place already has this name")
        gates = frozenset(self.gates)
        for name, lane in self.lanes.items():
            if lane.gate not in gates:
                raise ValueError(f"lanes.{name}.gate: {lane.gate!r} is not a gate frame")
        for name, camera in self.cameras.items():
            if camera.gate not in gates:
                raise ValueError(f"cameras.{name}.gate: {camera.gate!r} is not a gate frame")
            if name in self.assets:
                raise ValueError(f"cameras.{name}: an asset has the same name")
        for name, asset in self.assets.items():
            if asset.post not in self.frames:
                raise ValueError(f"assets.{name}.post: {asset.post!r} is not a frame")
            if asset.kind not in self.platforms:
                raise ValueError(f"assets.{name}.kind: no platform describes {asset.kind!r}")
        return self
