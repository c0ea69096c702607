"""The plan that a solution of the teacher comes to: takeovers first, and why in canonical words."""

import re
from collections.abc import Sequence
from typing import NamedTuple

from pa_console.llm.grammar import REASON_CHARS
from pa_console.schema.plan import Action, Plan
from pa_console.training.asked import asked
from pa_console.training.order import Ask, Order
from pa_console.training.teacher_backfill import Filled
from pa_console.training.teacher_draft import Command, Draft
from pa_console.training.teacher_roster import Roster

_STATE = re.compile(r"\w+: (free|alone|busy)(, \w+: (free|alone|busy))*")
"""What need not be said of those who are sent once a takeover is told."""


class Solution(NamedTuple):
    """Drafts for every ask, and what is added to them."""

    drafts: tuple[Draft, ...]
    filled: Filled


def plan_of(order: Order, solution: Solution, roster: Roster) -> Plan:
    """Return the plan of a solution: takeovers first, then the asks in order; else one hold."""
    commands = [*solution.filled.commands, *(c for d in solution.drafts for c in d.commands)]
    why = [*solution.filled.why]
    for draft in solution.drafts:
        said = [w for w in draft.why if not (solution.filled.why and _STATE.fullmatch(w))]
        why += [f"{w} ({draft.rule})" if draft.rule and "(" not in w else w for w in said]
    if not commands:
        commands = _holder([draft.ask for draft in solution.drafts], roster)
        why += ["hold"] if any(d.ask.task != "hold" for d in solution.drafts) else []
    return Plan(
        reason=_reason(order, why, roster),
        actions=tuple(Action(agent=agent, command=command) for agent, command in commands),
    )


def _reason(order: Order, why: Sequence[str], roster: Roster) -> str:
    """Return the canonical reason, no longer than a grammar lets it be."""
    words = f"asked: {asked(order, roster.world, roster.picture, roster.digest)}"
    parts = list(dict.fromkeys(why)) or ["nothing to do"]
    while len(parts) > 1 and len(words) + 2 + len(", ".join(parts)) > REASON_CHARS:
        parts.pop(-2 if parts[-1] == "hold" else -1)
    text = f"{words}; {', '.join(parts)}"
    return text if len(text) <= REASON_CHARS else text[: text.rfind(" ", 0, REASON_CHARS)]


def _holder(asks: Sequence[Ask], roster: Roster) -> list[Command]:
    """Return a hold by the first asset named that is up, else the first free one, else any."""
    named = [name for ask in asks for name in (*ask.who.names, ask.leaving) if roster.up(name)]
    names = [*named, *roster.free(("uav", "ugv", "robot")), *roster.every()]
    return [(name, "hold") for name in names[:1]]
