"""Grammars that make every completed answer readable (lark, in the dialect of llguidance).

A plan addresses only assets that are up, each at most once and in any order, with commands of its
kind and frames that exist. The text depends on nothing but its arguments, so its hash pins it.
"""

import json
from collections.abc import Collection, Iterable, Sequence
from typing import Literal, NamedTuple

from pa_console.schema.command import COMMANDS, Verb
from pa_console.schema.plan import MAX_ACTIONS, Action
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import KINDS, AssetKind, World

REASON_CHARS = 240
FEEDBACK_CHARS = 240
COMPARED_CHARS = 480
"""The longest feedback in which the console compares a plan with a reading."""
MOST_VIOLATED = 6
TEXT = r"[ !#-\[\]-~]"
"""Printable ASCII without the quote and the backslash: nothing to escape in JSON."""

ANY_TEXT = r"start: /(?s:.)*/" + "\n"
"""The grammar of whatever a model cares to write (evaluations only)."""

PLANNED = "; planned: "
"""The separator between the reading and the plan in a short verdict."""
Opinion = Literal["Success", "Failure"]

_REASON, _ACTIONS = '{"reason": "', '", "actions": ['
READ = r'^\{"reason": "[^"]*("|; (?!now: )((?!, else: )[^;:"])*: )'
"""A regular expression for a plan's beginning up to the end of its reading: to the first fact that
decides, whose name stands before a colon, or to the end of the reason."""
_AGENT = '{{"agent": "{}", "command": "'
_OPINION = '{{"id": "{}", "verdict": "'
_END = '"}'


def plan_grammar(  # noqa: PLR0917
    world: World,
    picture: Picture,
    agents: Collection[str] | None = None,
    frames: Collection[str] | None = None,
    verbs: Collection[Verb] = (),
    reasons: Sequence[str] = (),
) -> str:
    """Return the grammar of a plan; with no asset up, the only plan is one without actions.

    Only `agents` are addressed, only `frames` named and only `verbs` given, by default all. The
    plan's reason matches each of `reasons`, regular expressions in Rust's syntax that bound its
    length, if there are any.
    Whether an agent was used is a bit of llguidance's rule parameter, 64 of them (its limit and
    MAX_ACTIONS); raises ValueError when more assets are up.
    """
    up = addressable(world, picture, agents, verbs)
    if len(up) > MAX_ACTIONS:
        raise ValueError(f"{len(up)} assets are up and a plan can address {MAX_ACTIONS} at most")
    actions = ["first::0x0"] if up else []
    whole = [_literal(_REASON), "REASON", _literal(_ACTIONS), *actions]
    lines = [
        f"start: {' '.join(whole)} {_literal(']}')}",
        f"REASON: {_all(reasons) or _text('', REASON_CHARS)}",
    ]
    if up:
        one = [f"{_action(a, kind)} more::set_bit({i})" for i, (a, kind) in enumerate(up.items())]
        next_one = [f'", " {action} %if bit_clear({i})' for i, action in enumerate(one)]
        lines.append("first::_: " + "\n  | ".join(one))
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
    """Return the assets that a plan may address, with their kinds, in the order of the world."""
    return {
        name: spec.kind
        for name, spec in world.assets.items()
        if name in picture.assets and picture.assets[name].available
        if (agents is None or name in agents) and verbs_of(spec.kind, verbs)
    }


def reason_grammar(reasons: Sequence[str]) -> str:
    """Return the grammar of how a plan begins: its reason, and what stands before its actions.

    It matches each of `reasons`, regular expressions in Rust's syntax that bound its length. It
    goes on behind the reason, as models write the quote and what follows it in one token.
    """
    return f"start: {_literal(_REASON)} REASON {_literal(_ACTIONS)}\nREASON: {_all(reasons)}\n"


def begun_grammar(reasons: Sequence[str]) -> str:
    """Return the grammar of a plan without its actions; `reasons` are as in `reason_grammar`."""
    return f"start: {_literal(_REASON)} REASON {_literal(_END)}\nREASON: {_all(reasons)}\n"


def begun_reason(text: str) -> str:
    """Return the reason in `text`, the beginning of what either of the two accepts."""
    return text.removeprefix(_REASON).partition('"')[0]


def judge_grammar(rule_ids: Sequence[str], feedback: str = "") -> str:
    """Return the grammar of a verdict: an opinion on each rule in order, feedback, then overall.

    The feedback matches `feedback` (a regular expression in Rust's syntax) if there is one.
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


def compact_opening_grammar(asked: Sequence[str]) -> str:
    """Return the grammar of how a short verdict begins: with what was asked, as each of `asked`.

    They are regular expressions in Rust's syntax that bound its length. It ends in one terminal
    with what follows: the lexer is greedy, and a terminal of its own would have to be left before
    the next one is seen.
    """
    begins = _all([f"({each}){PLANNED}" for each in asked])
    opening = _literal('{"feedback": "')
    return f"start: {opening} ASKED\nASKED: {begins}\n"


def hinted(asked: str) -> str:
    """Return a short verdict that begins with `asked`, as far as that goes."""
    return json.dumps({"feedback": asked}, ensure_ascii=False)


def compact_judge_grammar(
    rule_ids: Sequence[str],
    feedback: str = "",
    verdicts: Sequence[Opinion] = ("Success", "Failure"),
    most: int = FEEDBACK_CHARS,
) -> str:
    """Return the grammar of a short verdict: feedback, the ids of violated rules, then overall.

    The feedback has `most` characters and matches `feedback` (a regular expression in Rust's
    syntax) if there is one; the verdict is one of `verdicts`.
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
    """Return a lark terminal for readable text of up to `most` characters, such as `pattern`."""
    return _all([*filter(None, [pattern]), f"{TEXT}{{1,{most}}}"])


def _all(patterns: Sequence[str]) -> str:
    """Return a lark terminal for what every one of `patterns` matches.

    A third one that counts characters, beside two that share much, would take the lexer too long.
    """
    return " & ".join(f"/{pattern}/" for pattern in patterns)


def _action(agent: str, kind: AssetKind) -> str:
    return f"{_literal(_AGENT.format(agent))} {kind}_command {_literal(_END)}"


def _commands(kind: AssetKind, verbs: Collection[Verb]) -> str:
    """Return the rule for the commands that an asset of `kind` can carry out."""
    words = [
        f"{_literal(verb + ' ')} frame" if COMMANDS[verb].takes_frame else _literal(verb)
        for verb in verbs_of(kind, verbs)
    ]
    return f"{kind}_command: " + " | ".join(words)


def verbs_of(kind: AssetKind, verbs: Collection[Verb]) -> list[Verb]:
    """Return the verbs for assets of `kind`; no `verbs` means every one of the vocabulary."""
    wanted = verbs or tuple(COMMANDS)
    return [verb for verb, spec in COMMANDS.items() if kind in spec.kinds and verb in wanted]


def _choice(words: Iterable[str]) -> str:
    return " | ".join(map(_literal, words))


def _literal(text: str) -> str:
    """Return `text` as a lark string; its escapes are those of JSON."""
    return json.dumps(text)


class CommandSlot(NamedTuple):
    """One `command` of a plan, for one of the `agents`."""

    agents: tuple[str, ...]
    command: str

    @property
    def verb(self) -> Verb:
        """The command's first word."""
        return Action(agent=self.agents[0], command=self.command).verb


def slot_grammar(slots: Sequence[CommandSlot], reasons: Sequence[str]) -> str:
    """Return the grammar (lark) of a plan with a command for each of `slots`, in their order.

    Its reason matches each of `reasons`, regular expressions in Rust's syntax that bound its
    length. Nobody has two commands. As in `plan_grammar`, whether an agent was used is a bit of
    llguidance's rule parameter.
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
