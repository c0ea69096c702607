"""The protocols of the console's surroundings, so that every screen stands alone."""

from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from pa_console.language.questions import Question
from pa_console.schema.events.event import Event, QuestionAnswered
from pa_console.schema.incident import Incident
from pa_console.schema.mission import Decision, Mission
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import RehearsedReading
from pa_console.schema.rule import Rule, RuleHit, RulesSeal
from pa_console.station.alternatives import Alternative

Clock = Callable[[], float]
"""Seconds that only grow; replaced in tests so that no test has to wait."""


@dataclass(frozen=True)
class JoinedTo:
    """Another station's session: its name, and who may countersign here, '' for nobody.

    `command_question` says what taking command from it would do; it raises ValueError where that
    cannot be. It is None for somebody who is no commander.
    """

    station: str
    signer: str = ""
    command_question: Callable[[], str] | None = None


class LiveStation(Protocol):
    """A live session: its events and the commands that may be given to it."""

    @property
    def rate(self) -> float:
        """Simulated seconds per second."""
        ...

    @rate.setter
    def rate(self, rate: float) -> None: ...

    @property
    def retriever(self) -> "RuleScorer":
        """The retriever over the rules in force now."""
        ...

    def run(self) -> AsyncIterator[Event]:
        """Yield every event of the session until it is closed."""
        ...

    def typing(self, text: str) -> None:
        """Note that a mission is being typed."""
        ...

    def point(self, name: str) -> None:
        """Note which asset, gate or track is marked on the screen, "" for none."""
        ...

    def question_in(self, text: str) -> Question | None:
        """Return the question about the record in a text; None for an order."""
        ...

    async def answer(
        self, question: Question, found: Callable[[Alternative], object] = ...
    ) -> QuestionAnswered:
        """Answer a question; every other plan for it goes to `found` as soon as it is rehearsed."""
        ...

    def submit(self, text: str) -> Mission:
        """Queue a mission; raises ValueError with a text for the operator when refused."""
        ...

    def decide(self, decision: Decision) -> None:
        """Answer the open approval; raises ValueError when none is open."""
        ...

    async def look_at(self, mission: Mission, asked: str) -> RehearsedReading | None:
        """Rehearse what another reading of a mission would lead to; None where that is unknown."""
        ...

    def other_ways(
        self, mission: Mission, asked: str, but: Plan
    ) -> AsyncIterator[RehearsedReading]:
        """Rehearse sound plans for a reading of a mission that are not the plan `but`."""
        ...

    def cancel(self) -> None:
        """Cancel the active mission at once, in any stage; ValueError when none is active."""
        ...

    def stop_all(self) -> None:
        """Make every asset hold and void open plans; nothing else is sent until `release`."""
        ...

    def release(self) -> None:
        """Release the stop; raises ValueError when nothing is stopped."""
        ...

    def acknowledge(self, alarm_id: str) -> None:
        """Note that the operator has seen an alarm; raises ValueError when it is not open."""
        ...

    def move(self, mission_id: str, by: int) -> None:
        """Move a waiting mission by `by` places, up when negative; ValueError when refused."""
        ...

    def defer(self, mission_id: str) -> None:
        """Let every other waiting mission go first; raises ValueError when it does not wait."""
        ...

    def withdraw(self, mission_id: str) -> None:
        """Take a waiting mission out of the queue; raises ValueError when it does not wait."""
        ...

    def revoke(self, order_id: str) -> None:
        """Take a standing order out of force; raises ValueError when it is not in force."""
        ...

    async def reload_rules(self) -> None:
        """Take the rules as their file has them now; why they cannot be taken is an event."""
        ...

    @property
    def rules_offered(self) -> str:
        """The reason why changed rules wait for the operator to accept them, "" when none do."""
        ...

    async def accept_rules(self) -> None:
        """Take the rules that wait for it; raises ValueError without any."""
        ...

    def inject(self, incident: Incident) -> None:
        """Change the simulated checkpoint; raises ValueError for an unknown asset or gate."""
        ...

    async def close(self, reason: str = ...) -> None:
        """End the session, with a reason for its log."""
        ...


class ShownRules(Protocol):
    """The rules in force."""

    @property
    def name(self) -> str:
        """The name of the rule set."""
        ...

    @property
    def seal(self) -> RulesSeal:
        """Version, content hash and standing of the rule set."""
        ...

    @property
    def rules(self) -> tuple[Rule, ...]:
        """Every rule, in file order."""
        ...

    @property
    def approvals(self) -> Mapping[str, int]:
        """The number of people who must approve each act, if more than one."""
        ...


class RuleScorer(Protocol):
    """Scores rules against a text."""

    def score_all(self, text: str) -> Sequence[RuleHit]:
        """Return one hit for every rule with its score and the score's components."""
        ...
