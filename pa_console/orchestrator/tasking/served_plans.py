"""The console's plan for a model's reading, if the model writes a reading and no plan.

The commands are those of `command_choices.py`; each goes to its first candidate.
"""

from collections.abc import Sequence

from pa_console.language.digest_facts import asset_state
from pa_console.llm.roles.grammar import CommandSlot
from pa_console.schema.plan import MAX_REASON, Action, Plan
from pa_console.schema.telemetry import Digest, Picture

MOST_FACTS = 4
"""The number of assets whose state a reason describes."""


def served_plan(asked: str, slots: Sequence[CommandSlot], digest: Digest) -> Plan:
    """Return the plan with the commands of `slots`, with the reading `asked` as its reason.

    The reason goes on with the state of the commanded assets.
    """
    actions = tuple(Action(agent=slot.agents[0], command=slot.command) for slot in slots)
    named = list(dict.fromkeys(action.agent for action in actions))[:MOST_FACTS]
    facts = ", ".join(f"{name}: {asset_state(digest, name)}" for name in named)
    return Plan(reason=f"{asked}; {facts or 'nobody to send'}"[:MAX_REASON], actions=actions)


def still(picture: Picture) -> tuple[CommandSlot, ...]:
    """Return a hold: the order if no part of the reading can be carried out."""
    up = (name for name, asset in picture.assets.items() if asset.available)
    return tuple(CommandSlot((name,), "hold") for name in list(up)[:1])
