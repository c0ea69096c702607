"""What one ask leads to: the commands, why, and what of it is left undone under which rule."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from pa_console.schema.world import World
from pa_console.training.order import Ask

Command = tuple[str, str]
"""An agent and its command."""
MOST_LISTED = 6
"""More names than these are only counted in a reason."""


class Draft(NamedTuple):
    """One way to serve an ask; without commands and `done` it is refused.

    `why` are the facts that decide, in words; `undone` says that only a part is done.
    """

    ask: Ask
    commands: tuple[Command, ...] = ()
    why: tuple[str, ...] = ()
    rule: str = ""
    done: bool = True
    undone: bool = False

    @property
    def agents(self) -> tuple[str, ...]:
        """Who is addressed."""
        return tuple(agent for agent, _ in self.commands)


@dataclass(frozen=True)
class Desk:
    """Who is taken already while the drafts of one order are made, and who is named in it."""

    used: frozenset[str] = frozenset()
    reserved: frozenset[str] = frozenset()

    def taken(self, own: Sequence[str] = ()) -> frozenset[str]:
        """Return whom an ask must not choose: those used, and those named elsewhere."""
        return self.used | (self.reserved - frozenset(own))


def refusal(ask: Ask, why: str, rule: str) -> Draft:
    """Return that nothing of `ask` is done."""
    return Draft(ask, why=(why,), rule=rule, done=False, undone=True)


def going(agent: str, place: str, world: World) -> Command:
    """Return the command that brings `agent` to `place`."""
    return agent, "return_to_base" if place == world.base else f"move_to {place}"


def goals(commands: Sequence[Command], world: World) -> Mapping[str, str]:
    """Return where every agent that is sent somewhere will be."""
    ends: dict[str, str] = {}
    for agent, command in commands:
        verb, _, frame = command.partition(" ")
        if verb == "return_to_base" or frame:
            ends[agent] = frame or world.base
    return ends


def listed(names: Sequence[str]) -> str:
    """Return a few names in words, or how many there are."""
    return ", ".join(names) if len(names) <= MOST_LISTED else f"{len(names)} assets"
