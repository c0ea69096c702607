"""The grammar of a plan whose commands are known: the model chooses who has each, and says why."""

import json
from collections.abc import Sequence
from typing import NamedTuple

from pa_console.schema.plan import Action


class Slot(NamedTuple):
    """One `command` of a plan, for one of the `agents`."""

    agents: tuple[str, ...]
    command: str


def slot_grammar(slots: Sequence[Slot], reasons: Sequence[str]) -> str:
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
