"""The ways in which servers hold an answer to a JSON schema, and the probe of what holds on one.

Each way has a field of its own in the request. A server that does not know a field may ignore it
and answer all the same. So every way is tried with a schema of random words that the prompt does
not mention: only a constrained answer has them.
"""

import json
import secrets
import string
from collections.abc import Callable
from contextlib import aclosing
from dataclasses import dataclass, field
from typing import Any, Literal, cast

from pa_console.llm.backend import ServerError
from pa_console.llm.roles.answer_schema import Schema
from pa_console.llm.servers.client import ServerClient

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


PROMPT = "Say hello."
PROBE_TOKENS = 48
PROBE_S = 20.0
"""The longest time of one probe, seconds."""
REFUSES = (400, 404, 415, 422, 500, 501)
"""The status codes of servers for a field, or a value of it, that they do not accept."""
WORD = 8
HOLDS, IGNORED = "holds", "ignored"


@dataclass(frozen=True)
class ProbeReport:
    """The result of every way, in words, and whether token probabilities are reported."""

    ways: dict[Way, str] = field(default_factory=dict[Way, str])
    chances: bool = False

    @property
    def way(self) -> Way | None:
        """The best way that holds; None where none does."""
        return next((way for way, found in self.ways.items() if found == HOLDS), None)

    @property
    def summary(self) -> str:
        """The conclusion, in a sentence."""
        return f"answers are held to their form by {self.way}" if self.way else UNCONSTRAINED

    @property
    def told(self) -> str:
        """All of it on a line."""
        ways = ", ".join(f"{way} {found}" for way, found in self.ways.items())
        return f"{self.summary} ({ways}); token chances {'told' if self.chances else 'not told'}"


UNCONSTRAINED = "nothing holds answers to their form, so one that cannot be read is asked for again"


async def probe(client: ServerClient, within_s: float = PROBE_S) -> ProbeReport:
    """Try every way, and token probabilities; each try may take `within_s` seconds.

    Raises ServerError when the server cannot be reached, is too slow or refuses every question.
    """
    chances = bool(await _asked(client, {}, within_s, chances=True, refused_too=True))
    if not chances:
        await _asked(client, {}, within_s)
    found: dict[Way, str] = {}
    for way in WAYS:
        found[way] = await _tried(client, way, within_s)
    return ProbeReport(found, chances)


async def _tried(client: ServerClient, way: Way, within_s: float) -> str:
    key, word = _random_word(), _random_word()
    schema: Schema = {
        "type": "object",
        "properties": {key: {"type": "string", "enum": [word]}},
        "required": [key],
        "additionalProperties": False,
    }
    held, text = f'{{"{key}":"{word}"}}', ""
    try:
        async with aclosing(
            client.ask("", PROMPT, PROBE_TOKENS, within_s, WAYS[way](schema))
        ) as pieces:
            async for piece in pieces:
                text += "".join(piece.text.split())
                if not held.startswith(text):
                    return IGNORED
    except ServerError as error:
        if error.status not in REFUSES:
            raise
        return f"refused ({error.status})"
    return HOLDS if text == held else IGNORED


async def _asked(
    client: ServerClient,
    extra: Schema,
    within_s: float,
    *,
    chances: bool = False,
    refused_too: bool = False,
) -> int:
    """Ask for a few words; return of how many tokens the chance was told."""
    told = 0
    try:
        async for piece in client.ask("", PROMPT, 4, within_s, extra, chances=chances):
            told += len(piece.chances)
    except ServerError as error:
        if not refused_too or error.status not in REFUSES:
            raise
    return told


def _random_word() -> str:
    return "".join(secrets.choice(string.ascii_lowercase) for _ in range(WORD))
