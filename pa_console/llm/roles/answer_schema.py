"""JSON schemas of answers, for servers: what a grammar says, as far as a schema can say it.

A server takes no grammar of ours. A schema holds the names, the commands and the verdicts to those
that there are; that nobody has two commands, and what a reason may state, it cannot say: the
safeguards look at every plan all the same.
"""

from collections.abc import Collection, Sequence
from typing import Any, get_args

from pa_console.llm.roles.grammar import (
    CommandSlot,
    Opinion,
    addressable,
    verbs_of,
)
from pa_console.schema.command import COMMANDS, Verb
from pa_console.schema.finding import JudgeOpinion
from pa_console.schema.plan import MAX_ACTIONS
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import AssetKind, World

Schema = dict[str, Any]
"""A JSON schema in few words: objects with all their properties, arrays, strings, enums, anyOf."""

TEXT: Schema = {"type": "string"}
"""Any text. Its length is not bounded here: llama.cpp takes half a minute to count 240 characters.
"""


def plan_schema(
    world: World,
    picture: Picture,
    agents: Collection[str] | None = None,
    frames: Collection[str] | None = None,
    verbs: Collection[Verb] = (),
) -> Schema:
    """Return the schema of a plan; its arguments are those of `plan_grammar`."""
    up = addressable(world, picture, agents, verbs)
    shown = [frame for frame in world.frames if frames is None or frame in frames]
    of_kind: dict[AssetKind, list[str]] = {}
    for name, kind in up.items():
        of_kind.setdefault(kind, []).append(name)
    ways = [
        _action(names, _commands(kind, shown, verbs))
        for kind, names in of_kind.items()
        if _commands(kind, shown, verbs)
    ]
    return _plan(ways, 0, min(len(up), MAX_ACTIONS) if ways else 0)


def slot_schema(slots: Sequence[CommandSlot], asked: str) -> Schema:
    """Return the schema of a plan that has the commands of `slots`, each with one of its agents.

    Its reason is what was `asked`.
    """
    ways = [_action(list(slot.agents), [slot.command]) for slot in slots]
    return _plan(ways, len(slots), len(slots), _one_of([asked]))


def verdict_schema(rule_ids: Sequence[str]) -> Schema:
    """Return the schema of a verdict: opinions on `rule_ids`, feedback, then Success or Failure."""
    fields: Schema = {}
    if rule_ids:
        one = _object({"id": _one_of(rule_ids), "verdict": _one_of(get_args(JudgeOpinion))})
        fields["rules"] = _list(one, len(rule_ids), len(rule_ids))
    fields["feedback"] = TEXT
    fields["verdict"] = _one_of(get_args(Opinion))
    return _object(fields)


def _plan(ways: Sequence[Schema], least: int, most: int, reason: Schema = TEXT) -> Schema:
    action = {"anyOf": list(ways)} if ways else _action(["nobody"], ["nothing"])
    return _object({"reason": reason, "actions": _list(action, least, most)})


def _action(agents: Sequence[str], commands: Sequence[str]) -> Schema:
    return _object({"agent": _one_of(agents), "command": _one_of(commands)})


def _commands(kind: AssetKind, frames: Sequence[str], verbs: Collection[Verb]) -> list[str]:
    """Return every command that an asset of `kind` can carry out."""
    commands: list[str] = []
    for verb in verbs_of(kind, verbs):
        takes_frame = COMMANDS[verb].takes_frame
        commands += [f"{verb} {frame}" for frame in frames] if takes_frame else [verb]
    return commands


def _object(properties: Schema) -> Schema:
    return {
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }


def _list(items: Schema, least: int, most: int) -> Schema:
    return {"type": "array", "items": items, "minItems": least, "maxItems": most}


def _one_of(words: Sequence[str]) -> Schema:
    return {"type": "string", "enum": list(words)}
