"""The ways in which servers hold an answer to a JSON schema: each has a field of its own for it.

A server that does not know a field may ignore it and answer all the same, so a way is tried before
it is relied on (`probe.py`).
"""

import json
from collections.abc import Callable
from typing import Any, Literal, cast

from pa_console.llm.roles.answer_schema import Schema

Way = Literal[
    "json_schema", "json_object", "structured_outputs", "guided_json", "format", "grammar"
]
"""A way to constrain a server's answer; see WAYS."""


def _json_schema(schema: Schema) -> Schema:
    named = {"name": "answer", "strict": True, "schema": schema}
    return {"response_format": {"type": "json_schema", "json_schema": named}}


def _json_object(schema: Schema) -> Schema:
    return {"response_format": {"type": "json_object", "schema": schema}}


WAYS: dict[Way, Callable[[Schema], Schema]] = {
    "json_schema": _json_schema,
    "json_object": _json_object,
    "structured_outputs": lambda schema: {"structured_outputs": {"json": schema}},
    "guided_json": lambda schema: {"guided_json": schema},
    "format": lambda schema: {"format": schema},
    "grammar": lambda schema: {"grammar": gbnf(schema)},
}
"""The request fields for a schema, the best known way first. `json_schema` is that of the OpenAI
interface, which llama.cpp, Ollama and vLLM have too; `json_object` that of llama-cpp-python;
`structured_outputs` and `guided_json` those of newer and older vLLM; `format` Ollama's own;
`grammar` llama.cpp's, in GBNF."""

_STRING = r'[^"\\\x7F\x00-\x1F]'
"""A character of a string with nothing to escape, in GBNF."""


def gbnf(schema: Schema) -> str:
    """Return the grammar of `schema` for llama.cpp: JSON spaced as prompts show it."""
    rules: dict[str, str] = {}
    rules["root"] = _rule(schema, "root", rules)
    return "".join(f"{name} ::= {rule}\n" for name, rule in rules.items())


def _rule(schema: Schema, name: str, rules: dict[str, str]) -> str:
    """Return what stands for `schema`; rules that it needs are added under names after `name`."""
    match schema:
        case {"anyOf": ways}:
            kinds = [_rule(way, f"{name}-{n}", rules) for n, way in enumerate(_several(ways))]
            return f"({' | '.join(kinds)})"
        case {"enum": words}:
            return f"({' | '.join(_literal(json.dumps(word)) for word in cast(list[str], words))})"
        case {"type": "string"}:
            return f'"\\"" {_STRING}* "\\""'
        case {"type": "array", "items": items}:
            rules[f"{name}-item"] = _rule(items, f"{name}-item", rules)
            return _items(f"{name}-item", int(schema["minItems"]), int(schema["maxItems"]))
        case {"type": "object", "properties": properties}:
            parts = [
                f"{_literal(json.dumps(key) + ': ')} {_rule(value, f'{name}-{key}', rules)}"
                for key, value in cast(Schema, properties).items()
            ]
            return f'"{{" {_literal(", ").join(f" {part} " for part in parts)} "}}"'
        case _:
            raise ValueError(f"no grammar is known for the schema {schema}")


def _items(item: str, least: int, most: int) -> str:
    """Return the rule of an array of `least` to `most` times `item`."""
    if most == 0:
        return '"[]"'
    more = f'{item} (", " {item}){{{max(least - 1, 0)},{most - 1}}}'
    return f'"[" {more} "]"' if least else f'"[" ({more})? "]"'


def _several(ways: Any) -> list[Schema]:
    return cast(list[Schema], ways)


def _literal(text: str) -> str:
    """Return `text` as a literal of GBNF."""
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
