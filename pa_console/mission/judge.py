"""The judge's verdicts on outcomes (Step 7): nobody waits for one.

Telemetry says whether a plan happened, and the mission goes on, or ends, at once. What the judge
says of the outcome changes nothing of that: it is asked while nobody needs the model, and told as
an event of its own.
"""

import asyncio
import json
from collections import deque
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import NamedTuple

from pa_console.language.clause_grammar import MOST_PLANNED, WORD, exactly
from pa_console.language.reading import planned, read_asked
from pa_console.llm.backend import CANCELLED
from pa_console.llm.roles.grammar import (
    COMPARED_CHARS,
    PLANNED,
    compact_judge_grammar,
    hinted,
    verdict_schema,
)
from pa_console.llm.roles.judge import Judgement, JudgeQuestion
from pa_console.llm.roles.role_model import PromptFormat, RoleModel, first_answer
from pa_console.mission.candidate import Candidate
from pa_console.mission.context import MissionContext
from pa_console.mission.picture_text import digest_picture
from pa_console.mission.tasking.fulfilment import gaps
from pa_console.mission.tasking.moves import PlanMoves
from pa_console.policy.findings import ORDER_ID
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Finding
from pa_console.schema.mission import Mission, Verification
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.rule import RuleHit
from pa_console.schema.telemetry import Digest, Picture, Selection
from pa_console.schema.world import World

FITS = "it fits"


class OrderComparison(NamedTuple):
    """The console's comparison after the judge's reading; `gaps` is None if that cannot be read."""

    planned: str
    gaps: tuple[str, ...] | None

    @property
    def told(self) -> str:
        """What is planned, and how it compares; open at the end where that is for the model."""
        if self.gaps is None:
            return f"{self.planned}; "
        return f"{self.planned}; {'; '.join(self.gaps) or FITS}"


def compare_with_order(asked: str, moves: PlanMoves) -> OrderComparison:
    """Compare a plan with a reading in a judge's words ("asked: 1 drone home")."""
    reading = read_asked(asked)
    words = _planned(asked, moves)
    if reading is None or not reading.readable:
        return OrderComparison(words, None)
    return OrderComparison(words, gaps(moves, reading))


def compared_grammar(
    opening: str, moves: PlanMoves, rule_ids: Sequence[str] = (), *, executed: bool = False
) -> str:
    """Return the grammar of a whole verdict that begins with `opening`.

    A plan that is not what was asked cannot be called a success. What the console cannot read is
    left to the model, as is which rules of `rule_ids` are violated, and of a plan that was
    `executed` what came of it.
    """
    asked = opening.partition(': "')[2].removesuffix(PLANNED)
    compared = compare_with_order(asked, moves)
    said = exactly((asked + PLANNED + compared.told)[:COMPARED_CHARS])
    if compared.gaps is None:
        said += f"{WORD}+"
    elif executed and not compared.gaps:
        said += f"; {WORD}+"
    verdicts = ("Failure",) if compared.gaps else ("Success", "Failure")
    return compact_judge_grammar(rule_ids, said, verdicts, COMPARED_CHARS)


def _planned(asked: str, moves: PlanMoves) -> str:
    """Return the planned orders, by name if the order names assets."""
    actions, world = moves.plan.actions, moves.world
    by_name = any(name in asked for name in world.assets)
    words = planned(actions, world, by_name=by_name)
    if len(words) > MOST_PLANNED:
        words = planned(actions, world, by_name=False)[:MOST_PLANNED]
    return json.dumps(words)[1:-1]


@dataclass(frozen=True)
class PlanCase:
    """A plan for `task`, with the rules and the picture that its planner was given.

    `asked` is what the operator says was asked; '' where the judge is to read that.
    """

    task: Mission
    hits: Sequence[RuleHit]
    digest: Digest
    plan: Plan
    findings: Sequence[Finding]
    rehearsal: Rehearsal
    asked: str = ""


@dataclass(frozen=True)
class OutcomeCase:
    """An executed plan: pictures `before` and after it, and what telemetry says of every action.

    `selection` is the part of the picture that the plan was made from; None means all of it. `said`
    is what the judge said of the plan, if it was asked about that too: what was asked is read once.
    """

    task: Mission
    before: Picture
    picture: Picture
    selection: Selection | None
    plan: Plan
    verification: Verification
    said: str = ""


def ask_about_plan(
    prompt_format: PromptFormat, world: World, rulebook: Rulebook, case: PlanCase
) -> JudgeQuestion:
    """Step 6: return the question whether the plan serves the task within the rules.

    Raises KeyError when a rule that was retrieved or found broken is not in `rulebook`.
    """
    rules = [rulebook.get(id_) for id_ in judged_rules(case.hits, case.findings)]
    prompt = prompt_format.judge(world, case.digest, rules, case.task, case.plan, case.rehearsal)
    ids = tuple(rule.id for rule in rules)
    if prompt_format.opening is None:
        return JudgeQuestion(
            "judge", prompt, prompt_format.verdict(ids), ids, schema=verdict_schema(ids)
        )
    moves = PlanMoves(world, case.rehearsal.before, case.plan)

    def goes_on(opening: str) -> str:
        return compared_grammar(opening, moves, ids)

    opening = prompt_format.opening(world, case.digest, case.task.text, case.asked)
    return JudgeQuestion("judge", prompt, opening, ids, goes_on, hint=hinted(case.plan.reason))


async def judge_plan(context: MissionContext, case: PlanCase, candidate: Candidate) -> Candidate:
    """Step 6: return `candidate` with the judge's verdict on its plan.

    Where a judge on a server gives none, the session's own model is asked in its place.
    """

    async def ask(model: RoleModel) -> Judgement:
        return await _judged(context, model, case, candidate.attempt)

    judgement = await first_answer(context.services.judges, ask, context.turn_to_own)
    sure = None if case.asked else judgement.confidence
    context.emit(
        ev.PlanJudged(
            attempt=candidate.attempt,
            verdict=judgement.verdict,
            error=judgement.error,
            usage=judgement.usage,
            confidence=sure,
        )
    )
    return replace(
        candidate,
        verdict=judgement.verdict,
        judge_error=judgement.error,
        judge_confidence=sure,
    )


async def _judged(
    context: MissionContext, model: RoleModel, case: PlanCase, attempt: int
) -> Judgement:
    """Ask `model` for its verdict on the plan number `attempt`."""
    services, started = context.services, perf_counter()
    question = ask_about_plan(model.prompt_format, services.fleet.world, services.rulebook, case)
    context.emit(
        ev.PromptBuilt(
            role="judge",
            attempt=attempt,
            system=question.prompt.system,
            user=question.prompt.user,
            seconds=perf_counter() - started,
            server=model.where,
        )
    )

    def on_text(piece: str) -> None:
        context.emit(ev.TextStreamed(role="judge", attempt=attempt, text=piece))

    with context.stopwatch.time("judging_s"):
        return await model.judge.judge(question, on_text)


def ask_about_outcome(
    prompt_format: PromptFormat, world: World, case: OutcomeCase
) -> JudgeQuestion:
    """Step 7: return the question whether the task was accomplished."""
    digest = digest_picture(case.picture, world, case.selection)
    prompt = prompt_format.outcome(world, digest, case.task, case.plan, case.verification)
    if prompt_format.outcome_opening is None:
        schema = verdict_schema([])
        return JudgeQuestion("outcome", prompt, prompt_format.verdict([]), schema=schema)
    moves = PlanMoves(world, case.before, case.plan)

    def goes_on(opening: str) -> str:
        return compared_grammar(opening, moves, executed=True)

    asked, compared, _ = case.said.partition(PLANNED)
    if compared and read_asked(asked) is not None:
        return JudgeQuestion("outcome", prompt, goes_on(f'{{"feedback": "{asked}{PLANNED}'))
    return JudgeQuestion("outcome", prompt, prompt_format.outcome_opening, goes_on=goes_on)


def judged_rules(hits: Sequence[RuleHit], findings: Sequence[Finding]) -> list[str]:
    """Return the ids of the retrieved rules that apply to the plan, and of every broken one."""
    findings = [finding for finding in findings if finding.rule_id != ORDER_ID]
    found = {finding.rule_id: finding for finding in findings}
    ids = [
        hit.rule_id
        for hit in hits
        if hit.rule_id not in found or found[hit.rule_id].status != "not_applicable"
    ]
    return ids + [f.rule_id for f in findings if f.broken and f.rule_id not in ids]


Start = Callable[[Coroutine[None, None, None]], object]
"""Runs work beside the session."""


@dataclass(frozen=True)
class _Asked:
    """The executed plan `attempt` of the mission of `context`, and what became of it."""

    context: MissionContext
    attempt: int
    case: OutcomeCase


class OutcomeVerdicts:
    """Asks for the verdicts of a session one by one, the oldest first.

    A prompt of a mission interrupts the one that is being given; it is asked for again later.
    """

    def __init__(self, start: Start, *, between_missions: bool) -> None:
        """`start` runs work beside the session.

        `between_missions` alone are verdicts asked for where the world waits for the model: there,
        an operator takes no time to decide, and what a mission takes is to be known.
        """
        self._start, self._between_missions = start, between_missions
        self._waiting: deque[_Asked] = deque()
        self._turn = asyncio.Lock()
        self.all_told = asyncio.Event()
        """Set while no verdict is outstanding."""
        self.all_told.set()

    def ask(self, context: MissionContext, attempt: int, case: OutcomeCase) -> None:
        """Ask the judge, when there is time, whether the executed plan `attempt` succeeded."""
        self._waiting.append(_Asked(context, attempt, case))
        self.all_told.clear()

    def go_on(self) -> None:
        """Ask for outstanding verdicts from now on: the mission does not need the model now."""
        if self._waiting and not self._between_missions and not self._turn.locked():
            self._start(self._go_on())

    async def work(self) -> bool:
        """Ask for every outstanding verdict; False when a mission needed the model before the end.

        What is outstanding then waits for the next call.
        """
        async with self._turn:
            while self._waiting:
                asked = self._waiting[0]
                told = await _verdict_on(asked)
                if told.error == CANCELLED:
                    return False
                self._tell(told)
            return True

    def give_up(self, reason: str) -> None:
        """Emit for every outstanding verdict why there is none."""
        while self._waiting:
            self._tell(unjudged(self._waiting[0].attempt, reason))

    def _tell(self, told: ev.OutcomeJudged) -> None:
        """Emit the oldest outstanding verdict and remove it from the queue."""
        self._waiting.popleft().context.emit(told)
        if not self._waiting:
            self.all_told.set()

    async def _go_on(self) -> None:
        await self.work()


async def _verdict_on(asked: _Asked) -> ev.OutcomeJudged:
    """Return the verdict that was asked for, or why there is none."""
    services = asked.context.services

    async def ask(model: RoleModel) -> Judgement:
        question = ask_about_outcome(model.prompt_format, services.fleet.world, asked.case)
        return await model.judge.judge(question)

    try:
        found = await first_answer(services.judges, ask, asked.context.turn_to_own)
    except Exception as error:  # a defect must not end the session
        return unjudged(asked.attempt, f"internal error: {type(error).__name__}: {error}")
    return ev.OutcomeJudged(
        attempt=asked.attempt, verdict=found.verdict, error=found.error, usage=found.usage
    )


def unjudged(attempt: int, reason: str) -> ev.OutcomeJudged:
    """Return the event for the outcome of `attempt` when there is no verdict on it."""
    return ev.OutcomeJudged(attempt=attempt, verdict=None, error=reason)
