"""A session as an MCAP file for Foxglove, Rerun and the `mcap` tools.

Topics: `/telemetry` (the picture), `/events/<kind>` (every other event as the log has it),
`/notices` (foxglove.Log, the event list of the screen) and `/scene` (foxglove.SceneUpdate: world,
assets and tracks in metres, frame `world`). The models have only the fields that are used here.
"""

import json
import math
from collections.abc import Callable, Iterable, Iterator
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, BinaryIO, cast

from pydantic import BaseModel, TypeAdapter

from pa_console import __version__
from pa_console.export.source_log import OpenedSession
from pa_console.resources import install_hint
from pa_console.schema.base import Payload, Point
from pa_console.schema.events.event import Event, TelemetryReceived
from pa_console.schema.telemetry import AssetTelemetry, Picture, Track
from pa_console.schema.world import World
from pa_console.session.state import SessionState
from pa_console.session.state_parts import Notice

_LEVELS = {"info": 2, "warning": 3, "alarm": 4}
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


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
    """A line through points; with `type` 0 it is open, with 1 its ends are joined."""

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
    """One thing in the scene; a later one with the same id replaces it."""

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
    """Return the assets and tracks of a picture, and delete all other entities in `before`."""
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


if TYPE_CHECKING:
    from mcap.writer import Writer


Schema = dict[str, Any]


def model_schema(model: type[BaseModel]) -> Schema:
    """Return the schema of a model's JSON, with references replaced by their definitions."""
    return _resolved(TypeAdapter(model).json_schema(mode="serialization"))


def event_schema(payload: type[Payload]) -> Schema:
    """Return the schema of an event with `payload`, as in a line of the log."""
    event = TypeAdapter(Event).json_schema(mode="serialization")
    del event["$defs"]
    event["properties"]["data"] = {}
    schema = _resolved(event)
    schema["title"] = payload.__name__
    schema["properties"]["data"] = model_schema(payload)
    return schema


def _resolved(schema: Schema) -> Schema:
    """Replace every reference, because viewers that plot a field by path follow no references."""
    definitions: Schema = schema.pop("$defs", {})

    def put(node: Any) -> Any:
        if isinstance(node, list):
            return [put(item) for item in cast(list[Any], node)]
        if not isinstance(node, dict):
            return node
        given = cast(Schema, node)
        if "$ref" in given:
            beside = {name: put(value) for name, value in given.items() if name != "$ref"}
            return put(definitions[given["$ref"].rpartition("/")[2]]) | beside
        return {name: put(value) for name, value in given.items() if name != "discriminator"}

    return put(schema)


NEEDED = f"MCAP files need another package: {install_hint('mcap')}"


class LogMessage(BaseModel):
    """A foxglove.Log; the levels are 1 debug, 2 info, 3 warning, 4 error."""

    timestamp: Time
    level: int
    message: str
    name: str
    file: str = ""
    line: int = 0


def write_mcap(
    session: OpenedSession,
    world: World | None,
    target: BinaryIO,
    advance: Callable[[int], None] = lambda _count: None,
) -> int:
    """Write `session` to `target` and return the number of messages.

    `advance` is called with the number of events written since its last call. Without `world`, the
    scene has no ground. Raises ValueError if the `mcap` package is not installed.
    """
    try:
        from mcap.writer import Writer  # noqa: PLC0415 - an extra, see NEEDED
    except ImportError as error:
        raise ValueError(NEEDED) from error
    writer = Writer(target)
    writer.start(profile="", library=f"pa-console {__version__}")
    pinned = session.started.model_dump(mode="json")
    writer.add_metadata("session", {name: _plain(value) for name, value in pinned.items()})
    channels = Channels(writer)
    state, last, drawn = SessionState(), None, frozenset[str]()
    for index in range(len(session.recording)):
        event = session.recording[index]
        stamp = stamp_ns(event.t)
        if world is not None and not index:
            _draw(channels, world_scene(world, stamp), stamp)
        state.apply(event)
        channels.event(event, stamp, index)
        for notice in _new(state, last):
            channels.add("/notices", "foxglove.Log", _logged(notice, stamp), stamp)
        last = state.notices[-1] if state.notices else None
        if isinstance(event.data, TelemetryReceived):
            scene = picture_scene(event.data.picture, drawn, stamp)
            drawn = frozenset(entity.id for entity in scene.entities)
            _draw(channels, scene, stamp)
        advance(1)
    writer.finish()
    return channels.messages


def stamp_ns(moment: datetime) -> int:
    """Return nanoseconds since 1970, exactly."""
    past = moment - _EPOCH
    return ((past.days * 86400 + past.seconds) * 10**6 + past.microseconds) * 1000


class Channels:
    """The topics of a file, each of which is registered with its first message."""

    def __init__(self, writer: "Writer") -> None:
        self.messages = 0
        self._writer = writer
        self._ids: dict[str, int] = {}

    def event(self, event: Event, stamp: int, sequence: int) -> None:
        """Add an event of the log under its kind; from telemetry, add only the picture."""
        data = event.data
        if isinstance(data, TelemetryReceived):
            self.add("/telemetry", "pa_console.Picture", data.picture, stamp, sequence)
            return
        topic = f"/events/{data.kind}"
        if topic not in self._ids:
            kind = type(data)
            self._register(topic, f"pa_console.{kind.__name__}", event_schema(kind))
        self._write(topic, event, stamp, sequence)

    def add(self, topic: str, name: str, message: BaseModel, stamp: int, sequence: int = 0) -> None:
        """Add a message; its model defines the schema, which is called `name`."""
        if topic not in self._ids:
            self._register(topic, name, model_schema(type(message)))
        self._write(topic, message, stamp, sequence)

    def _register(self, topic: str, name: str, schema: Schema) -> None:
        data = json.dumps(schema).encode()
        schema_id = self._writer.register_schema(name, "jsonschema", data)
        self._ids[topic] = self._writer.register_channel(topic, "json", schema_id)

    def _write(self, topic: str, message: BaseModel, stamp: int, sequence: int) -> None:
        data = message.model_dump_json().encode()
        self._writer.add_message(self._ids[topic], stamp, data, stamp, sequence)
        self.messages += 1


def _draw(channels: Channels, scene: SceneUpdate, stamp: int) -> None:
    channels.add("/scene", "foxglove.SceneUpdate", scene, stamp)


def _new(state: SessionState, last: Notice | None) -> Iterator[Notice]:
    """Yield the notices that came after `last`, oldest first."""
    added: list[Notice] = []
    for notice in reversed(state.notices):
        if notice is last:
            break
        added.append(notice)
    yield from reversed(added)


def _logged(notice: Notice, stamp: int) -> LogMessage:
    """Return a notice as a message; a notice hidden from the operator has the debug level."""
    level = 1 if notice.hidden else _LEVELS[notice.level]
    at = time_of(stamp)
    return LogMessage(timestamp=at, level=level, message=notice.text, name=notice.subject)


def _plain(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value)
