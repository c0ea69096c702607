"""The form of answers: grammars with which every complete answer is readable, and JSON schemas.

Grammars are written in lark, in the dialect of llguidance. A plan addresses only available assets,
each at most once and in any order, with commands for its kind and frames that exist. The text of a
grammar depends only on the arguments, so that its hash can pin it.

Servers do not accept these grammars, but JSON schemas. A schema limits names, commands and verdicts
to valid ones. It cannot express that no asset has two commands, or limit the content of a reason.
The safeguards check every plan anyway.
"""

import json
from collections.abc import Collection, Iterable, Sequence
from typing import Any, Literal, NamedTuple, get_args

from pa_console.schema.command import COMMANDS, Verb
from pa_console.schema.finding import JudgeOpinion
from pa_console.schema.plan import MAX_ACTIONS, Action
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import KINDS, AssetKind, World

REASON_CHARS = 240
FEEDBACK_CHARS = 240
COMPARED_CHARS = 480
"""The limit on the length of feedback in which the console compares a plan with a reading."""
MOST_VIOLATED = 6
TEXT = r"[ !#-\[\]-~]"
"""Printable ASCII without the quote and the backslash, so that JSON needs no escapes."""

ANY_TEXT = r"start: /(?s:.)*/" + "\n"
"""The grammar that allows any text (evaluations only)."""

PLANNED = "; planned: "
"""The separator between the reading and the plan in a short verdict."""
Opinion = Literal["Success", "Failure"]

_REASON, _ACTIONS = '{"reason": "', '", "actions": ['
READ = r'^\{"reason": "[^"]*("|; (?!now: )((?!, else: )[^;:"])*: )'
"""A regular expression for the beginning of a plan, up to the end of its reading. A reading ends at
the end of the reason, or before the first deciding fact, which begins with a name and a colon."""
_AGENT = '{{"agent": "{}", "command": "'
_OPINION = '{{"id": "{}", "verdict": "'
_END = '"}'

Schema = dict[str, Any]
"""A simple JSON schema: objects with all properties required, arrays, strings, enums, anyOf."""

TEXT_SCHEMA: Schema = {"type": "string"}
"""The schema that allows any text. It does not limit the length, because llama.cpp takes half a
minute to count 240 characters."""


def plan_grammar(  # noqa: PLR0917
    world: World,
    picture: Picture,
    agents: Collection[str] | None = None,
    frames: Collection[str] | None = None,
    verbs: Collection[Verb] = (),
    reasons: Sequence[str] = (),
) -> str:
    """Return the grammar of a plan; if no asset is available, the only plan has no actions.

    Only `agents`, `frames` and `verbs` are allowed; the default is all of them. If there are
    `reasons`, the plan's reason matches each of them. They are regular expressions in Rust's syntax
    and limit its length. A bit of llguidance's rule parameter marks each used agent. The parameter
    has 64 bits, which is MAX_ACTIONS; raises ValueError if more assets are available.
    """
    up = addressable(world, picture, agents, verbs)
    if len(up) > MAX_ACTIONS:
        raise ValueError(
            f"{len(up)} assets are available, but a plan can address at most {MAX_ACTIONS}"
        )
    actions = ["first::0x0"] if up else []
    whole = [_literal(_REASON), "REASON", _literal(_ACTIONS), *actions]
    lines = [
        f"start: {' '.join(whole)} {_literal(']}')}",
        f"REASON: {_all(reasons) or _text('', REASON_CHARS)}",
    ]
    if up:
        action_forms = [
            f"{_action(a, kind)} more::set_bit({i})" for i, (a, kind) in enumerate(up.items())
        ]
        next_one = [f'", " {action} %if bit_clear({i})' for i, action in enumerate(action_forms)]
        lines.append("first::_: " + "\n  | ".join(action_forms))
        lines.append('more::_: ""\n  | ' + "\n  | ".join(next_one))
        lines += [_commands(kind, verbs) for kind in KINDS if kind in up.values()]
        lines.append("frame: " + _choice(f for f in world.frames if frames is None or f in frames))
    return "\n".join(lines) + "\n"


def addressable(
    world: World,
    picture: Picture,
    agents: Collection[str] | None = None,
    verbs: Collection[Verb] = (),
) -> dict[str, AssetKind]:
    """Return the kinds of the assets that a plan may address, in the order of the world."""
    return {
        name: spec.kind
        for name, spec in world.assets.items()
        if name in picture.assets and picture.assets[name].available
        if (agents is None or name in agents) and verbs_of(spec.kind, verbs)
    }


def reason_grammar(reasons: Sequence[str]) -> str:
    """Return the grammar of a plan's beginning: its reason, and the text before its actions.

    The reason matches each of `reasons`, which are regular expressions in Rust's syntax and limit
    its length. The grammar includes the text after the reason, because models write the closing
    quote and this text in one token.
    """
    return f"start: {_literal(_REASON)} REASON {_literal(_ACTIONS)}\nREASON: {_all(reasons)}\n"


def begun_grammar(reasons: Sequence[str]) -> str:
    """Return the grammar of a plan without its actions; `reasons` are as in `reason_grammar`."""
    return f"start: {_literal(_REASON)} REASON {_literal(_END)}\nREASON: {_all(reasons)}\n"


def begun_reason(text: str) -> str:
    """Return the reason in `text`, which matches `reason_grammar` or `begun_grammar`."""
    return text.removeprefix(_REASON).partition('"')[0]


def judge_grammar(rule_ids: Sequence[str], feedback: str = "") -> str:
    """Return the grammar of a verdict: an opinion on each rule in order, feedback, verdict.

    If `feedback` is not empty, it is a regular expression in Rust's syntax that the feedback
    matches.
    """
    opinions = [
        f"{_literal(_OPINION.format(rule_id))} opinion {_literal(_END)}" for rule_id in rule_ids
    ]
    listed = f" {_literal(', ')} ".join(opinions)
    whole = [_literal('{"rules": ['), *filter(None, [listed]), _literal('], "feedback": "')]
    whole += ["FEEDBACK", _literal('", "verdict": "'), "verdict", _literal(_END)]
    lines = [
        f"start: {' '.join(whole)}",
        f"FEEDBACK: {_text(feedback, FEEDBACK_CHARS)}",
        f"verdict: {_choice(('Success', 'Failure'))}",
    ]
    if rule_ids:
        lines.append(f"opinion: {_choice(('complies', 'violates', 'unclear'))}")
    return "\n".join(lines) + "\n"


def compact_opening_grammar(readings: Sequence[str]) -> str:
    """Return the grammar of a short verdict's beginning, which is the judge's reading.

    The reading matches each of `readings`, which are regular expressions in Rust's syntax and limit
    its length. The reading and the text after it are one terminal. If they were two, the greedy
    lexer could not detect the end of the first before it saw the second.
    """
    begins = _all([f"({reading}){PLANNED}" for reading in readings])
    opening = _literal('{"feedback": "')
    return f"start: {opening} ASKED\nASKED: {begins}\n"


def hinted(reading: str) -> str:
    """Return a short verdict with `reading`, as a hint for the beginning of the answer."""
    return json.dumps({"feedback": reading}, ensure_ascii=False)


def compact_judge_grammar(
    rule_ids: Sequence[str],
    feedback: str = "",
    verdicts: Sequence[Opinion] = ("Success", "Failure"),
    most: int = FEEDBACK_CHARS,
) -> str:
    """Return the grammar of a short verdict: feedback, the ids of violated rules, verdict.

    The feedback has at most `most` characters. If `feedback` is not empty, it is a regular
    expression in Rust's syntax that the feedback matches. The verdict is one of `verdicts`.
    """
    whole = [_literal('{"feedback": "'), "FEEDBACK", _literal('", "violated": [')]
    whole += [
        *["violated"] * bool(rule_ids),
        _literal('], "verdict": "'),
        "verdict",
        _literal(_END),
    ]
    lines = [
        f"start: {' '.join(whole)}",
        f"FEEDBACK: {_text(feedback, most)}",
        f"verdict: {_choice(verdicts)}",
    ]
    if rule_ids:
        lines.append(f'violated: "" | id ({_literal(", ")} id){{0,{MOST_VIOLATED - 1}}}')
        lines.append(f"id: {_choice(json.dumps(rule_id) for rule_id in rule_ids)}")
    return "\n".join(lines) + "\n"


def _text(pattern: str, most: int) -> str:
    """Return a lark terminal for printable text of 1 to `most` characters that matches `pattern`.

    An empty `pattern` allows any printable text.
    """
    return _all([*filter(None, [pattern]), f"{TEXT}{{1,{most}}}"])


def _all(patterns: Sequence[str]) -> str:
    """Return a lark terminal for texts that match every one of `patterns`.

    Keep the number of patterns small, because a third pattern that counts characters, in addition
    to two similar ones, would slow the lexer too much.
    """
    return " & ".join(f"/{pattern}/" for pattern in patterns)


def _action(agent: str, kind: AssetKind) -> str:
    return f"{_literal(_AGENT.format(agent))} {kind}_command {_literal(_END)}"


def _commands(kind: AssetKind, verbs: Collection[Verb]) -> str:
    """Return the grammar rule for the commands that assets of `kind` can carry out."""
    words = [
        f"{_literal(verb + ' ')} frame" if COMMANDS[verb].takes_frame else _literal(verb)
        for verb in verbs_of(kind, verbs)
    ]
    return f"{kind}_command: " + " | ".join(words)


def verbs_of(kind: AssetKind, verbs: Collection[Verb]) -> list[Verb]:
    """Return those of `verbs` that assets of `kind` can carry out; empty `verbs` stands for all."""
    chosen = verbs or tuple(COMMANDS)
    return [verb for verb, spec in COMMANDS.items() if kind in spec.kinds and verb in chosen]


def _choice(words: Iterable[str]) -> str:
    return " | ".join(map(_literal, words))


def _literal(text: str) -> str:
    """Return `text` as a lark string, which has the same escapes as JSON."""
    return json.dumps(text)


class CommandSlot(NamedTuple):
    """A `command` of a plan, which one of the `agents` is to carry out."""

    agents: tuple[str, ...]
    command: str

    @property
    def verb(self) -> Verb:
        """The command's first word."""
        return Action(agent=self.agents[0], command=self.command).verb


def slot_grammar(slots: Sequence[CommandSlot], reasons: Sequence[str]) -> str:
    """Return the grammar (lark) of a plan with a command for each of `slots`, in their order.

    The reason matches each of `reasons`, which are regular expressions in Rust's syntax and limit
    its length. No agent has two commands. As in `plan_grammar`, a bit of llguidance's rule
    parameter marks each used agent.
    """
    agents = list(dict.fromkeys(name for slot in slots for name in slot.agents))
    whole = [json.dumps('{"reason": "'), "REASON", json.dumps('", "actions": ['), "slot0::0x0"]
    lines = [
        f"start: {' '.join(whole)} {json.dumps(']}')}",
        f"REASON: {' & '.join(f'/{reason}/' for reason in reasons)}",
    ]
    for number, slot in enumerate(slots):
        last = number == len(slots) - 1
        ways: list[str] = []
        for name in slot.agents:
            bit = agents.index(name)
            action = json.dumps(Action(agent=name, command=slot.command).model_dump())
            follows = "" if last else f' ", " slot{number + 1}::set_bit({bit})'
            ways.append(f"{json.dumps(action)}{follows} %if bit_clear({bit})")
        lines.append(f"slot{number}::_: " + "\n  | ".join(ways))
    return "\n".join(lines) + "\n"


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
        _action_schema(names, _commands_of(kind, shown, verbs))
        for kind, names in of_kind.items()
        if _commands_of(kind, shown, verbs)
    ]
    return _plan(ways, 0, min(len(up), MAX_ACTIONS) if ways else 0)


def slot_schema(slots: Sequence[CommandSlot], reading: str) -> Schema:
    """Return the schema of a plan with the commands of `slots`, each for one of the slot's agents.

    The plan's reason is the `reading`.
    """
    ways = [_action_schema(list(slot.agents), [slot.command]) for slot in slots]
    return _plan(ways, len(slots), len(slots), _one_of([reading]))


def verdict_schema(rule_ids: Sequence[str]) -> Schema:
    """Return the schema of a verdict: opinions on `rule_ids`, feedback, Success or Failure."""
    fields: Schema = {}
    if rule_ids:
        opinion = _object({"id": _one_of(rule_ids), "verdict": _one_of(get_args(JudgeOpinion))})
        fields["rules"] = _list(opinion, len(rule_ids), len(rule_ids))
    fields["feedback"] = TEXT_SCHEMA
    fields["verdict"] = _one_of(get_args(Opinion))
    return _object(fields)


def _plan(ways: Sequence[Schema], least: int, most: int, reason: Schema = TEXT_SCHEMA) -> Schema:
    action = {"anyOf": list(ways)} if ways else _action_schema(["nobody"], ["nothing"])
    return _object({"reason": reason, "actions": _list(action, least, most)})


def _action_schema(agents: Sequence[str], commands: Sequence[str]) -> Schema:
    return _object({"agent": _one_of(agents), "command": _one_of(commands)})


def _commands_of(kind: AssetKind, frames: Sequence[str], verbs: Collection[Verb]) -> list[str]:
    """Return every command that assets of `kind` can carry out."""
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
