"""The plans of one mission: each with its attempts, decisions, commands and what came of it."""

from dataclasses import dataclass, field

from pa_console.schema.events.event import DecisionMade, PlanHalted
from pa_console.session.state.mission_trace import Attempt, CommandTrace, MissionTrace, VerifiedPlan
from pa_console.session.status_words import Status, status_of


@dataclass
class Round:
    """One plan from its first attempt to its verification or halt; `number` counts from 0."""

    number: int
    attempts: list[Attempt] = field(default_factory=list[Attempt])
    decisions: list[DecisionMade] = field(default_factory=list[DecisionMade])
    commands: list[CommandTrace] = field(default_factory=list[CommandTrace])
    halts: list[PlanHalted] = field(default_factory=list[PlanHalted])
    verified: list[VerifiedPlan] = field(default_factory=list[VerifiedPlan])
    voided: str = ""

    @property
    def name(self) -> str:
        """The phase of a workflow that the plan is for, else which plan of the mission it is."""
        phase = self.attempts[-1].phase if self.attempts else ""
        return f"Phase {phase}" if phase else f"Plan {self.number + 1}"

    @property
    def outcome(self) -> Status:
        """How the plan ended."""
        if self.halts:
            return status_of("outcome", "halted")
        ended = self.verified[-1].verification.outcome if self.verified else "none"
        return status_of("outcome", ended)


def rounds(trace: MissionTrace) -> list[Round]:
    """Return every plan of the mission, oldest first; the last one even when it has nothing yet."""
    last = max([a.round for a in trace.attempts], default=0)
    result = [Round(number) for number in range(last + 1)]
    by_attempt = {attempt.number: attempt.round for attempt in trace.attempts}
    for attempt in trace.attempts:
        result[attempt.round].attempts.append(attempt)
    for made in trace.decisions:
        result[by_attempt.get(made.attempt, last)].decisions.append(made)
    for sent in trace.commands.values():
        result[min(sent.round, last)].commands.append(sent)
    for halt in trace.halts:
        result[by_attempt.get(halt.attempt, last)].halts.append(halt)
    for item in trace.verified:
        result[min(item.round, last)].verified.append(item)
    result[-1].voided = trace.voided
    return result


def chosen_attempt(trace: MissionTrace, now: Round) -> Attempt | None:
    """Return the attempt that is up for approval or was decided on, else the latest."""
    number = None
    if trace.approval is not None:
        number = trace.approval.attempt
    else:
        taken = [made for made in now.decisions if made.accepted and made.decision.settles]
        number = taken[-1].attempt if taken else None
    found = next((attempt for attempt in now.attempts if attempt.number == number), None)
    return found or (now.attempts[-1] if now.attempts else None)
