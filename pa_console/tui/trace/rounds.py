"""The plans of one mission: each with its attempts, decisions, commands and what came of it."""

from dataclasses import dataclass, field

from textual.content import Content

from pa_console.schema.events.event import DecisionMade, PlanHalted
from pa_console.session.state.mission_trace import Attempt, CommandTrace, MissionTrace, VerifiedPlan
from pa_console.tui.status_words import BAD, NOTE, QUIET, Term, term
from pa_console.tui.words import count


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
    def outcome(self) -> Term:
        """How the plan ended."""
        if self.halts:
            return Term("■", "HALTED", BAD)
        if self.verified:
            return term("outcome", self.verified[-1].verification.outcome)
        return Term("–", "not carried out", QUIET)

    @property
    def title(self) -> Content:
        """Phase, outcome and how many attempts and commands it took."""
        phase = self.attempts[-1].phase if self.attempts else ""
        name = f"Phase {phase}" if phase else f"Plan {self.number + 1}"
        mark = self.outcome
        numbers = ", ".join(str(attempt.number) for attempt in self.attempts)
        note = f"  attempt {numbers}; {count(len(self.commands), 'command')}"
        return Content.assemble(
            (name, f"bold {NOTE}"), (f"  {mark.glyph} {mark.word}", mark.style), (note, QUIET)
        )


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


def latest(trace: MissionTrace) -> Round:
    """Return the plan that the mission is at."""
    return rounds(trace)[-1]


def earlier(trace: MissionTrace) -> list[Round]:
    """Return the plans before it that came to something."""
    return [given for given in rounds(trace)[:-1] if given.attempts or given.commands]
