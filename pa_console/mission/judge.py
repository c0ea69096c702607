"""The judge's verdict on a plan, and the second reader where an order is in doubt.

The JudgeLLM reads the order for itself; the console compares its reading with the plan, and the
judge may only object.
"""

import asyncio
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import NamedTuple

from pa_console.language.clause_grammar import MOST_PLANNED, WORD, exactly
from pa_console.language.reading import agree, asked_words, planned, read_asked
from pa_console.llm.roles.clause_reader import ClauseReader, ask_what_is_asked
from pa_console.llm.roles.grammar import (
    COMPARED_CHARS,
    PLANNED,
    compact_judge_grammar,
    hinted,
    verdict_schema,
)
from pa_console.llm.roles.judge import Judge, Judgement, JudgeQuestion, OrderReading
from pa_console.llm.roles.role_model import PromptFormat, RoleModel, first_answer
from pa_console.mission.context import MissionContext
from pa_console.mission.plan import Candidate, PlanForDecision, ReadAgain, with_commands_given
from pa_console.mission.propose import PlannerAnswer
from pa_console.mission.tasking.fulfilment import gaps
from pa_console.mission.tasking.moves import PlanMoves
from pa_console.policy.findings import ORDER_ID
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Finding
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.rule import RuleHit
from pa_console.schema.telemetry import Digest
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


DOUBT = 0.8
"""Below this confidence of planner or judge, an order is read again. Of 398 orders in people's
words that neither model had met, the planner read 62 of the 206 below it as meant and the second
reader 118; of the 192 above it, 177 and 175."""


PATIENCE_S = 15.0
"""The longest wait for the second reader, its loading included, seconds; then the plan is proposed
without it."""


LEAST = 0.3
"""Below this confidence of its own, the second reader's reading is only offered."""


def in_doubt(shown: Candidate) -> bool:
    """Return whether an order should be read again before its plan is proposed.

    It should if a model was unsure, the judge objects, or words of the order are left over. A plan
    that is blocked, and one that the operator wrote, is not put in doubt.
    """
    if shown.own or shown.examination.blocked or shown.sure is None:
        return False
    return shown.sure < DOUBT or shown.objected or bool(shown.mentions.gaps)


async def read_again(context: MissionContext, case: PlanCase, shown: Candidate) -> Candidate:
    """Return `shown` with the second reader's reading; unchanged without an answer."""
    services, world = context.services, context.services.fleet.world
    reader = services.server_reader or services.second_reader
    if reader is None or not services.variant.read_again or not in_doubt(shown):
        return shown
    with context.stopwatch.time("readings_s"):
        try:
            async with asyncio.timeout(PATIENCE_S):
                if isinstance(reader, ClauseReader):
                    read = await reader.read(ask_what_is_asked(world, case.digest, case.task))
                else:
                    question = ask_about_plan(
                        services.prompt_format, world, services.rulebook, case
                    )
                    read = await reader.read(question)
        except TimeoutError:
            read = OrderReading("", f"no answer within {PATIENCE_S:.0f} s")
    context.emit(
        ev.OrderReadAgain(
            attempt=shown.attempt,
            model=reader.model,
            asked=read.asked,
            error=read.error,
            usage=read.usage,
            confidence=read.confidence,
        )
    )
    measured = isinstance(reader, Judge)
    if not read.asked or (measured and read.confidence is None):
        return shown
    own, sure = asked_words(shown.examination.plan.reason).rstrip("; "), read.confidence or 0.0
    same = agree(own, read.asked, world.base)
    again = ReadAgain(read.asked, sure, same=same, measured=measured)
    return replace(shown, read_again=again)


def likelier(shown: Candidate) -> bool:
    """Return whether the second reader's reading is likelier than that of the plan on show.

    If an order is in doubt, it is right twice as often as the planner.
    """
    read = shown.read_again
    return read is not None and read.measured and not read.same and read.confidence >= LEAST


async def judge(context: MissionContext, planned: PlanForDecision) -> PlanForDecision:
    """Step 6: ask for the JudgeLLM's verdict on the plan to decide on; a blocked plan needs none.

    A trained judge reads the order for itself. Where it objects and its reading is the likelier
    one, a plan that serves that becomes the one to decide on, if nothing blocks it and the judge
    passes it.
    """
    answered = planned.answered
    first = await _judged(context, answered, planned.best)
    asked = first.second_reading
    if asked and context.services.variant.second_reading:
        other = await with_commands_given(
            context, answered, asked, read_asked(asked), first, instead="judged"
        )
        if other is not first:
            other = await _judged(context, answered, other)
        first = first if other.objected else other
    return replace(planned, best=await _as_read_again(context, answered, first))


async def _as_read_again(
    context: MissionContext, answered: PlannerAnswer, shown: Candidate
) -> Candidate:
    """Let another model read an order that is in doubt; where it is surer, its reading is served.

    The judge is then told what was asked: it judges the plan for that. Where both readings come to
    the same orders, there is nothing to choose between: the second reader bears the plan out.
    """
    if answered.retrieved.chosen or shown.examination.rehearsal is None:
        return shown
    shown = await read_again(context, _case(answered, shown, shown.examination.rehearsal), shown)
    second = shown.read_again
    if second is None or not likelier(shown):
        return shown
    reading = read_asked(second.asked)
    other = await with_commands_given(
        context, answered, second.asked, reading, shown, instead="read_again"
    )
    if other is shown or other.examination.blocked:
        return shown
    if other.mentions.gaps and not shown.mentions.gaps:
        return shown  # what accounts for every word is not given up for what does not
    if not shown.objected and other.does_as(shown):
        return replace(shown, read_again=replace(second, same=True))
    other = await _judged(context, answered, other, second.asked)
    return shown if other.objected else replace(other, read_again=replace(second, same=True))


async def _judged(
    context: MissionContext, answered: PlannerAnswer, candidate: Candidate, asked: str = ""
) -> Candidate:
    """Return `candidate` with the judge's verdict on its plan.

    The judge reads the order unless it is told `asked`. Where a judge on a server gives no verdict,
    the session's own model is asked in its place.
    """
    found, services, attempt = candidate.examination, context.services, candidate.attempt
    if found.blocked or found.rehearsal is None or not services.variant.judging:
        return candidate
    case = _case(answered, candidate, found.rehearsal, asked)

    def on_text(piece: str) -> None:
        context.emit(ev.TextStreamed(role="judge", attempt=attempt, text=piece))

    async def ask(model: RoleModel) -> Judgement:
        started = perf_counter()
        question = ask_about_plan(
            model.prompt_format, services.fleet.world, services.rulebook, case
        )
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
        with context.stopwatch.time("judging_s"):
            return await model.judge.judge(question, on_text)

    judgement = await first_answer(services.judges, ask, context.turn_to_own)
    sure = None if case.asked else judgement.confidence
    context.emit(
        ev.PlanJudged(
            attempt=attempt,
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


def _case(
    answered: PlannerAnswer, candidate: Candidate, rehearsal: Rehearsal, asked: str = ""
) -> PlanCase:
    found, question = candidate.examination, answered.question
    return PlanCase(
        answered.retrieved.task,
        answered.retrieved.hits,
        question.digest,
        found.plan,
        found.findings,
        rehearsal,
        asked or question.asked,
    )
