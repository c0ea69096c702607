"""The checkpoint as a Foxglove scene: world, assets and tracks in metres, frame `world`.

The models have the fields of foxglove.SceneUpdate that are used here.
"""

import math
from collections.abc import Iterable

from pydantic import BaseModel

from pa_console.schema.base import Point
from pa_console.schema.telemetry import AssetTelemetry, Picture, Track
from pa_console.schema.world import World


class Time(BaseModel):
    """A time since 1970-01-01 UTC, or a duration."""

    sec: int = 0
    nsec: int = 0


class Vector(BaseModel):
    """A vector in metres."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


class Quaternion(BaseModel):
    """A rotation, by default none."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0


class Pose(BaseModel):
    """The position and orientation of a thing."""

    position: Vector = Vector()
    orientation: Quaternion = Quaternion()


class Color(BaseModel):
    """A colour, each part from 0 to 1."""

    r: float
    g: float
    b: float
    a: float = 1.0


class Solid(BaseModel):
    """A cube or a sphere."""

    pose: Pose
    size: Vector
    color: Color


class LinePrimitive(BaseModel):
    """A line through points: `type` 0 leaves it open, 1 joins its ends."""

    type: int
    pose: Pose = Pose()
    thickness: float = 0.5
    scale_invariant: bool = False
    points: list[Vector]
    color: Color
    colors: list[Color] = []
    indices: list[int] = []


class TextPrimitive(BaseModel):
    """A text that faces the viewer."""

    pose: Pose
    billboard: bool = True
    font_size: float = 12.0
    scale_invariant: bool = True
    color: Color
    text: str


class Entity(BaseModel):
    """One thing in the scene; a later one of the same id replaces it."""

    timestamp: Time
    frame_id: str = "world"
    id: str
    lifetime: Time = Time()
    frame_locked: bool = False
    cubes: list[Solid] = []
    spheres: list[Solid] = []
    lines: list[LinePrimitive] = []
    texts: list[TextPrimitive] = []


class Deletion(BaseModel):
    """The removal of an entity from the scene."""

    timestamp: Time
    type: int = 0
    id: str


class SceneUpdate(BaseModel):
    """A change of the scene: removed entities, and new or changed ones."""

    deletions: list[Deletion] = []
    entities: list[Entity] = []


WHITE, GREY = Color(r=0.9, g=0.9, b=0.9), Color(r=0.5, g=0.5, b=0.5)
GREEN, AMBER = Color(r=0.2, g=0.8, b=0.3), Color(r=1.0, g=0.7, b=0.1)
RED, BLUE = Color(r=0.9, g=0.2, b=0.2), Color(r=0.3, g=0.6, b=1.0)


def time_of(stamp_ns: int) -> Time:
    """Return nanoseconds since 1970 as a Foxglove time."""
    sec, nsec = divmod(stamp_ns, 10**9)
    return Time(sec=sec, nsec=nsec)


def world_scene(world: World, stamp_ns: int) -> SceneUpdate:
    """Return the fixed scene: perimeter, walls, lanes, zones and the frames' names."""
    lines = [_line(world.perimeter, WHITE, closed=True)]
    lines += [_line((wall.start, wall.end), GREY, wall.thickness_m) for wall in world.walls]
    lines += [_line(lane.points, BLUE) for lane in world.lanes.values()]
    lines += [_line(zone.polygon, RED, closed=True) for zone in world.zones.values()]
    texts = [
        TextPrimitive(pose=_pose(frame.at), color=WHITE, text=name)
        for name, frame in world.frames.items()
    ]
    ground = Entity(timestamp=time_of(stamp_ns), id="world", lines=lines, texts=texts)
    return SceneUpdate(entities=[ground])


def picture_scene(picture: Picture, before: frozenset[str], stamp_ns: int) -> SceneUpdate:
    """Return the assets and tracks of a picture, and remove other entities of `before`."""
    stamp = time_of(stamp_ns)
    entities = [_asset(asset, stamp) for asset in picture.assets.values()]
    entities += [_track(track, stamp) for track in picture.tracks.values()]
    gone = sorted(before - {entity.id for entity in entities})
    deletions = [Deletion(timestamp=stamp, id=name) for name in gone]
    return SceneUpdate(deletions=deletions, entities=entities)


def _asset(asset: AssetTelemetry, stamp: Time) -> Entity:
    color = GREEN if asset.available else RED if asset.status == "failed" else AMBER
    pose = _pose(asset.position, asset.heading_deg)
    body = Solid(pose=pose, size=Vector(x=2.0, y=1.2, z=1.0), color=color)
    label = TextPrimitive(
        pose=_pose(asset.position, z=2.0), color=color, text=f"{asset.id} {asset.task}"
    )
    route = [_line((asset.position, *asset.route), color, 0.2)] if asset.route else []
    return Entity(timestamp=stamp, id=f"asset {asset.id}", cubes=[body], texts=[label], lines=route)


def _track(track: Track, stamp: Time) -> Entity:
    bad = track.intent == "hostile" or track.identity == "unauthorized"
    color = RED if bad else GREEN if track.identity == "authorized" else AMBER
    size = max(2.0, 2.0 * track.uncertainty_m)
    body = Solid(pose=_pose(track.position), size=Vector(x=size, y=size, z=2.0), color=color)
    words = f"{track.id} {track.identity} {track.status}"
    label = TextPrimitive(pose=_pose(track.position, z=3.0), color=color, text=words)
    return Entity(timestamp=stamp, id=f"track {track.id}", spheres=[body], texts=[label])


def _line(
    points: Iterable[Point], color: Color, thickness: float = 0.5, *, closed: bool = False
) -> LinePrimitive:
    row = [Vector(x=x, y=y) for x, y in points]
    return LinePrimitive(type=int(closed), thickness=thickness, points=row, color=color)


def _pose(at: Point, heading_deg: float = 0.0, z: float = 0.0) -> Pose:
    half = math.radians(heading_deg) / 2
    turn = Quaternion(z=math.sin(half), w=math.cos(half))
    return Pose(position=Vector(x=at[0], y=at[1], z=z), orientation=turn)
