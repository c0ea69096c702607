"""JSON Schemas of the messages in an MCAP file, each complete in itself without references."""

from typing import Any, cast

from pydantic import BaseModel, TypeAdapter

from pa_console.schema.event import Event
from pa_console.schema.event_base import Payload

Schema = dict[str, Any]


def model_schema(model: type[BaseModel]) -> Schema:
    """Return the schema of a model's JSON, definitions put where they are referred to."""
    return _resolved(TypeAdapter(model).json_schema(mode="serialization"))


def event_schema(payload: type[Payload]) -> Schema:
    """Return the schema of an event that carries `payload`, as a line of the log has it."""
    event = TypeAdapter(Event).json_schema(mode="serialization")
    del event["$defs"]
    event["properties"]["data"] = {}
    schema = _resolved(event)
    schema["title"] = payload.__name__
    schema["properties"]["data"] = model_schema(payload)
    return schema


def _resolved(schema: Schema) -> Schema:
    """Replace every reference; viewers that plot a field by its path need not follow any."""
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
