"""A session as an MCAP file, which Foxglove, Rerun and the `mcap` tools open.

Topics: `/telemetry` (the picture), `/events/<kind>` (every other event as the log has it),
`/notices` (foxglove.Log, the event list of the screen) and `/scene` (foxglove.SceneUpdate).
"""

import json
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, BinaryIO, cast

from pydantic import BaseModel, TypeAdapter

from pa_console import __version__
from pa_console.export.mcap_scene import SceneUpdate, Time, picture_scene, time_of, world_scene
from pa_console.export.source_log import OpenedSession
from pa_console.schema.base import Payload
from pa_console.schema.events.event import Event, TelemetryReceived
from pa_console.schema.world import World
from pa_console.session.state import Notice, SessionState

if TYPE_CHECKING:
    from mcap.writer import Writer


Schema = dict[str, Any]


def model_schema(model: type[BaseModel]) -> Schema:
    """Return the schema of a model's JSON, with definitions in the place of references."""
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
    """Replace every reference: viewers that plot a field by its path do not follow them."""
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


NEEDED = "MCAP files need one more package: pip install 'pa-console[mcap]'"
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_LEVELS = {"info": 2, "warning": 3, "alarm": 4}


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

    `advance` gets the number of further events that are done. Without `world` the scene has no
    ground. Raises ValueError if the `mcap` package is not installed.
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
    """The topics of a file, each registered with its first message."""

    def __init__(self, writer: "Writer") -> None:
        self.messages = 0
        self._writer = writer
        self._ids: dict[str, int] = {}

    def event(self, event: Event, stamp: int, sequence: int) -> None:
        """Add an event of the log under its kind; of telemetry, only the picture."""
        data = event.data
        if isinstance(data, TelemetryReceived):
            self.add("/telemetry", "pa_console.Picture", data.picture, stamp, sequence)
            return
        topic = f"/events/{data.kind}"
        if topic not in self._ids:
            kind = type(data)
            self._register(topic, f"pa_console.{kind.__name__}", event_schema(kind))
        self._write(topic, event, stamp, sequence)

    def add(
        self,
        topic: str,
        name: str,
        message: BaseModel,
        stamp: int,
        sequence: int = 0,
    ) -> None:
        """Add a message; its model gives the schema, called `name`."""
        if topic not in self._ids:
            self._register(topic, name, model_schema(type(message)))
        self._write(topic, message, stamp, sequence)

    def _register(self, topic: str, name: str, schema: Schema) -> None:
        data = json.dumps(schema).encode()
        known = self._writer.register_schema(name, "jsonschema", data)
        self._ids[topic] = self._writer.register_channel(topic, "json", known)

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
    """Return a notice as a message; one hidden from the operator has the debug level."""
    level = 1 if notice.hidden else _LEVELS[notice.level]
    at = time_of(stamp)
    return LogMessage(timestamp=at, level=level, message=notice.text, name=notice.subject)


def _plain(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value)
