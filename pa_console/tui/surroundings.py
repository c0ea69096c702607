"""The surroundings of the console: its clock, its station and rules, a session that it joined."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from pa_console.policy.rulebook import Rulebook
from pa_console.schema.rule import Rule, RulesSeal

if TYPE_CHECKING:
    from pa_console.station.joined_station import JoinedStation
    from pa_console.station.station import ControlStation

LiveStation: TypeAlias = "ControlStation | JoinedStation"
"""A live session: its events, and the commands that may be given to it."""

SecondsClock = Callable[[], float]
"""Seconds that only grow; replaced in tests so that no test has to wait."""


@dataclass(frozen=True)
class JoinedTo:
    """Another station's session: its name, and the person who may countersign here, or ''.

    `command_question` describes the effects of taking command; it raises ValueError if that is
    impossible. It is None for anyone but a commander.
    """

    station: str
    signer: str = ""
    command_question: Callable[[], str] | None = None


class InForce(NamedTuple):
    """A rule set as the console sees it."""

    name: str
    seal: RulesSeal
    rules: tuple[Rule, ...]
    approvals: Mapping[str, int]


ShownRules = Rulebook | InForce
"""The rules in force, at the start of the console or since a change."""
