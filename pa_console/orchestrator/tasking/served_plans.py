"""The plan that the console makes of what was asked, where a model says that and no more.

The commands are those of `command_choices.py`; of those who could have one, it goes to the first.
"""

from collections.abc import Sequence

from pa_console.llm.roles.grammar import CommandSlot
from pa_console.orders.digest_facts import asset_state
from pa_console.schema.plan import MAX_REASON, Action, Plan
from pa_console.schema.telemetry import Digest, Picture

MOST_FACTS = 4
"""Assets of whom a reason says how they stand."""


def served_plan(asked: str, slots: Sequence[CommandSlot], digest: Digest) -> Plan:
    """Return the plan with the commands of `slots`, whose reason is what was `asked`.

    The reason goes on with how those stand who have a command.
    """
    actions = tuple(Action(agent=slot.agents[0], command=slot.command) for slot in slots)
    named = list(dict.fromkeys(action.agent for action in actions))[:MOST_FACTS]
    facts = ", ".join(f"{name}: {asset_state(digest, name)}" for name in named)
    return Plan(reason=f"{asked}; {facts or 'nobody to send'}"[:MAX_REASON], actions=actions)


def still(picture: Picture) -> tuple[CommandSlot, ...]:
    """Return that somebody holds: what is ordered where nothing that was asked can be."""
    up = (name for name, asset in picture.assets.items() if asset.available)
    return tuple(CommandSlot((name,), "hold") for name in list(up)[:1])
