"""Steps 3 to 5 of a mission: candidate plans, and the choice of one to show to the operator."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import prod
from typing import Literal

from pa_console.language.canonical.order import Reading
from pa_console.language.canonical.reading import asked_words, read_asked, read_reason
from pa_console.language.mention_check import NOTHING_SAID, MentionCheck, check_mentions
from pa_console.language.references.conversation import leaning_words
from pa_console.mission.context import MissionContext
from pa_console.mission.examine import Examination, examine
from pa_console.mission.planning.backfill import in_turn
from pa_console.mission.planning.fulfilment import gaps
from pa_console.mission.planning.moves import PlanMoves
from pa_console.mission.planning.obstacles import Unmet, unmet_asks, within_capability
from pa_console.mission.planning.propose import (
    NumberedPlan,
    PlannerAnswer,
    ask_for_others,
    ask_planner,
    ask_who,
    commands_for,
    propose_instead,
)
from pa_console.mission.retrieve import RetrievedRules
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Verdict
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Plan
from pa_console.session.confidence import Reader, WeighedReading, read_apart

VOUCHED = 0.8
"""The least confidence with which the judge confirms a reading that has no confidence."""


UNTOLD = "not known: how sure the server's model is of what was asked"

MOST_SERVED = 6
"""The number of plans with the console's own commands that are tried while each is blocked."""


@dataclass(frozen=True)
class Candidate:
    """An examined plan, with the judge's answer once it has been judged."""

    attempt: int
    examination: Examination
    gaps: tuple[str, ...] = ()
    """The differences between the plan and its planner's reading."""
    unmet: tuple[str, ...] = ()
    """The parts of the planner's reading that the plan leaves out, with the reasons."""
    narrowed: bool = False
    """True if the plan leaves out a part of the reading that is not fulfilled already."""
    mentions: MentionCheck = NOTHING_SAID
    """The comparison of the reading with the words of the order."""
    confidence: float | None = None
    """The planner's confidence in its reading."""
    verdict: Verdict | None = None
    judge_error: str = ""
    judge_confidence: float | None = None
    """The judge's confidence in its reading."""
    own: bool = False
    """True if the operator, an agent or the console wrote the plan, and no model did."""
    by_server: bool = False
    """True if a model on a server wrote the plan."""

    @property
    def badness(self) -> tuple[int, ...]:
        """The number of blocking findings, of gaps and of warnings; a smaller tuple is better."""
        blocking, warnings = self.examination.badness
        return blocking, len(self.gaps), warnings

    @property
    def sound(self) -> bool:
        """True if no rule blocks the plan and the plan matches its planner's reading."""
        return not any(self.badness[:2])

    @property
    def asked(self) -> str:
        """The reading in the plan's reason, in canonical words; '' if there is none."""
        return asked_words(self.examination.plan.reason).rstrip("; ")

    @property
    def sure(self) -> float | None:
        """The lower of planner's and judge's confidence; None if neither reported a confidence."""
        reported = (self.confidence, self.judge_confidence)
        return min((sure for sure in reported if sure is not None), default=None)

    @property
    def all_gaps(self) -> tuple[str, ...]:
        """The evidence against the reading of the order, in words.

        If a model on a server wrote the plan and reported no confidence, a judge that read the
        order by itself must confirm the reading with a confidence of at least VOUCHED.
        """
        judged = self.judge_confidence
        unknown = self.by_server and self.confidence is None
        untold = unknown and (judged is None or judged < VOUCHED)
        return (*self.mentions.gaps, *(UNTOLD,) * untold)

    @property
    def objected(self) -> bool:
        """True if the judge finds the plan wrong."""
        return self.verdict is not None and self.verdict.verdict == "Failure"


def better(first: Candidate | None, other: Candidate) -> Candidate:
    """Return the candidate with less evidence against it; `first` if they are equal."""
    return other if first is None or other.badness < first.badness else first


@dataclass(frozen=True)
class PlanForDecision:
    """The plan for the operator's decision, and the planner's answer for its task."""

    answered: PlannerAnswer
    best: Candidate
    readings: tuple[WeighedReading, ...] = ()
    """The readings of the order, the likeliest first; empty before the judge's verdict."""
    served: WeighedReading | None = None
    """The reading that the plan serves."""
    steps: tuple["PlanForDecision", ...] = ()
    """The plan of each step, if the order is in steps."""
    by_grammar: bool = False
    """True if a grammar read the order, and no model, so that the reading is certain."""

    @property
    def confidence(self) -> float | None:
        """The confidence in the reading, as shown to the operator.

        None unless the second reader, or both planner and judge, report a confidence. For an order
        in steps, it is the product of the steps' confidences.
        """
        if self.by_grammar:
            return 1.0
        if self.steps:
            sure = [step.confidence for step in self.steps]
            confidences = [chance for chance in sure if chance is not None]
            return prod(confidences) if len(confidences) == len(sure) else None
        readers = {reader for reading in self.readings for reader in reading.evidence.chances}
        confidences = "second" in readers or readers >= {"planner", "judge"}
        return self.served.chance if confidences and self.served is not None else None

    @property
    def read_apart(self) -> bool:
        """True if another reading of the order, or of one of its steps, is plausible."""
        if self.steps:
            return any(step.read_apart for step in self.steps)
        return self.served is not None and read_apart(self.served, self.readings)


@dataclass(frozen=True)
class PlanningFailure:
    """A planner's answer without a plan; `error` is the reason."""

    answered: PlannerAnswer
    error: str


async def plan(
    context: MissionContext,
    retrieved: RetrievedRules,
    reasons: Sequence[str] = (),
    previous: str = "",
) -> PlanForDecision | PlanningFailure:
    """Plan and examine (steps 3 to 5) until no rule blocks the plan, at most 1 + repairs times.

    `reasons` are the faults of the `previous` plan. The best plan is returned, even if it is
    blocked. If the model only states its reading and the console makes the plan, the model is not
    asked again, because its reading would be the same.
    """
    best: Candidate | None = None
    reading: Reading | None = None
    error, seen, left = "", set[Plan](), context.services.variant.repairs
    while True:
        answered = await ask_planner(context, retrieved, reasons, previous)
        proposal = answered.proposal
        answer = proposal.text
        if proposal.plan is None:
            error, reasons = proposal.error, (proposal.error,)
        else:
            if context.services.variant.fitting:
                chosen = answered.question.asked
                read = read_asked(chosen) if chosen else read_reason(proposal.plan.reason)
                reading = reading or read
            attempt = NumberedPlan(
                answered.attempt,
                proposal.plan,
                proposal.confidence,
                answered.model.server is not None,
            )
            sent_back = await _examined(context, retrieved, attempt, reading)
            best = better(best, sent_back)
            if not best.sound and not seen:
                best = await _first_sound(context, answered, reading, best)
            if best.attempt > sent_back.attempt:
                sent_back = best
            reasons = sent_back.examination.faults if best.examination.blocked else ()
            answer = sent_back.examination.plan.answer
        again = not proposal.fatal and left > 0 and proposal.plan not in seen
        if not (again and reasons) or (
            answered.model.prompt_format.served and proposal.plan is not None
        ):
            break
        left -= 1
        if proposal.plan is not None:
            seen.add(proposal.plan)
        previous = answer
        context.emit(ev.RepairRequested(attempt=context.attempts, reasons=tuple(reasons)))
    if best is None:
        return PlanningFailure(answered, error)
    return PlanForDecision(answered, best)


async def take(
    context: MissionContext,
    answered: PlannerAnswer,
    written: Plan,
    author: Literal["operator", "agent", "console"] = "operator",
) -> PlanForDecision:
    """Examine a plan that no model wrote like any other plan (step 5)."""
    number = context.next_attempt()
    context.emit(ev.PlanProposed(attempt=number, author=author, text=written.answer, plan=written))
    retrieved = answered.retrieved
    candidate = await _examined(context, retrieved, NumberedPlan(number, written), None, own=True)
    return PlanForDecision(answered, candidate)


async def reexamine(context: MissionContext, task: Mission, approved: Plan) -> Examination | None:
    """Examine an `approved` plan again; return the examination if it is blocked now, else None."""
    fresh = await safeguards(context, task, approved)
    return fresh if fresh.blocked else None


async def _first_sound(
    context: MissionContext, answered: PlannerAnswer, reading: Reading | None, best: Candidate
) -> Candidate:
    """Examine the planner's other answers until one is sound; return the best candidate.

    First, the planner's first answer is examined with each guard waiting for its relief. If the
    console can parse the reading in that answer, the other answers have the same reading. If none
    is sound, the console gives the commands, and the model only assigns agents to them.
    """
    fleet = context.services.fleet
    relieved = in_turn(best.examination.plan, fleet.picture(), fleet.world)
    if relieved is not None:
        attempt = propose_instead(context, answered, relieved)
        best = better(best, await _examined(context, answered.retrieved, attempt, reading))
    if best.sound:
        return best
    readable = reading is not None and reading.readable
    for other in await ask_for_others(context, answered, as_asked=readable):
        if best.sound:
            break
        best = better(best, await _examined(context, answered.retrieved, other, reading))
    if readable and not best.sound:
        best = await with_commands_given(context, answered, answered.reading, reading, best)
    return best


async def with_commands_given(
    context: MissionContext,
    answered: PlannerAnswer,
    reading_text: str,
    reading: Reading | None,
    best: Candidate,
    *,
    reader: Reader = "planner",
) -> Candidate:
    """Examine plans for a reading that consist of the console's own commands.

    The plans serve less and less of the reading, until no rule blocks a plan. A sound plan is
    returned even if `best`, the best plan so far, is for another reading and has less evidence
    against it. Otherwise the best of all these plans is returned.
    """
    retrieved = answered.retrieved
    for slots in await commands_for(context, retrieved, reading_text, MOST_SERVED):
        attempt = await ask_who(context, answered, reading_text, slots, reader)
        if attempt is None:
            continue
        candidate = await _examined(context, retrieved, attempt, reading)
        best = candidate if candidate.sound else better(best, candidate)
        if not candidate.examination.blocked:
            break
    return best


async def _examined(
    context: MissionContext,
    retrieved: RetrievedRules,
    attempt: NumberedPlan,
    reading: Reading | None,
    *,
    own: bool = False,
) -> Candidate:
    """Examine a plan; if it is `own`, it is not compared with the order's words."""
    plan_, task, fleet = attempt.plan, retrieved.task, context.services.fleet
    examination = await safeguards(context, task, plan_)
    before = examination.rehearsal.before if examination.rehearsal is not None else fleet.picture()
    amiss: tuple[str, ...] = ()
    left: tuple[Unmet, ...] = ()
    if reading is not None and reading.readable and examination.rehearsal is not None:
        moves = PlanMoves(fleet.world, before, plan_)
        amiss = gaps(moves, within_capability(reading, fleet.world))
        left = unmet_asks(moves, reading, task.text)
    unmet = tuple(part.words for part in left)
    mentions = NOTHING_SAID
    if not own and not retrieved.chosen:
        reading_text = asked_words(plan_.reason).rstrip("; ")
        words = context.as_described(task.text, reading_text)
        follows = task.follows
        mentions = check_mentions(fleet.world, before, words, reading_text, plan_, unmet, follows)
        leaning = () if follows else leaning_words(context.services.scene, task.text)
        mentions = mentions._replace(leaning=leaning)
    if examination.rehearsal is not None and context.services.variant.rehearsal:
        context.emit(
            ev.PlanRehearsed(
                attempt=attempt.number,
                rehearsal=examination.rehearsal,
                seconds=examination.rehearsal_s,
            )
        )
    context.emit(
        ev.PlanChecked(
            attempt=attempt.number,
            findings=examination.findings,
            seconds=examination.checks_s,
            unmet=unmet,
            gaps=mentions.gaps,
        )
    )
    return Candidate(
        attempt.number,
        examination,
        amiss,
        unmet,
        any(not part.fulfilled for part in left),
        mentions,
        attempt.confidence,
        own=own,
        by_server=attempt.by_server,
    )


async def safeguards(context: MissionContext, task: Mission, checked: Plan) -> Examination:
    """Examine a plan for `task` in the present state."""
    services = context.services
    examination = await examine(
        checked,
        task,
        services.fleet,
        services.rulebook,
        context.monitor,
        services.variant,
        context.mission.text,
        services.standing,
    )
    context.stopwatch.add("checks_s", examination.checks_s)
    context.stopwatch.add("rehearsal_s", examination.rehearsal_s)
    return examination
