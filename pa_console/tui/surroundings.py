"""The environment of the console: its clock, station and rules, and the session it has joined."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from pa_console.policy.rulebook import Rulebook
from pa_console.schema.rule import Rule, RulesSeal

if TYPE_CHECKING:
    from pa_console.station.joined.joined_station import JoinedStation
    from pa_console.station.station import ControlStation

LiveStation: TypeAlias = "ControlStation | JoinedStation"
"""A live session on this machine or another, with its events and its commands."""

SecondsClock = Callable[[], float]
"""A monotonic clock in seconds; tests replace it so that they do not have to wait."""


@dataclass(frozen=True)
class JoinedTo:
    """Another station's session: its name, and the person who may countersign here, or ''.

    `command_question` returns a question with the effects of taking command; it raises ValueError
    if that is impossible. It is None unless the person is a commander.
    """

    station: str
    signer: str = ""
    command_question: Callable[[], str] | None = None


class InForce(NamedTuple):
    """The part of a rule set that the console shows."""

    name: str
    seal: RulesSeal
    rules: tuple[Rule, ...]
    approvals: Mapping[str, int]


ShownRules = Rulebook | InForce
"""The rules in force, as they were at the console's start or as changed since."""
