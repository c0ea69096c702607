"""The judge's verdict on a plan, and the plan for the likeliest reading of the order.

The judge reads the order without seeing the plan. The console compares this reading with the plan,
and the judge can only object.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import NamedTuple

from pa_console.language.canonical.reading import planned, read_asked
from pa_console.language.clause_grammar import MOST_PLANNED, WORD, exactly
from pa_console.llm.roles.grammar import (
    COMPARED_CHARS,
    PLANNED,
    compact_judge_grammar,
    hinted,
    verdict_schema,
)
from pa_console.llm.roles.judge import Judgement, JudgeQuestion
from pa_console.llm.roles.role_model import PromptFormat, RoleModel, first_answer
from pa_console.mission.context import MissionContext
from pa_console.mission.plan import Candidate, PlanForDecision, with_commands_given
from pa_console.mission.planning.fulfilment import gaps
from pa_console.mission.planning.moves import PlanMoves
from pa_console.mission.planning.obstacles import obstacle_to
from pa_console.mission.planning.propose import PlannerAnswer
from pa_console.mission.readings import may_decide, read_order
from pa_console.policy.findings import ORDER_ID
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.command import STILL
from pa_console.schema.events import event as ev
from pa_console.schema.finding import MAX_FEEDBACK, Finding, Verdict
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.rule import RuleHit
from pa_console.schema.telemetry import Digest
from pa_console.schema.world import World
from pa_console.session.confidence import WeighedReading

FITS = "it fits"


class OrderComparison(NamedTuple):
    """The console's comparison of a plan with a reading.

    `gaps` is None if the console cannot parse the reading.
    """

    planned: str
    gaps: tuple[str, ...] | None

    @property
    def words(self) -> str:
        """The comparison in words, without an end if the model has to complete it."""
        if self.gaps is None:
            return f"{self.planned}; "
        return f"{self.planned}; {'; '.join(self.gaps) or FITS}"


def compare_with_order(reading_text: str, moves: PlanMoves) -> OrderComparison:
    """Compare a plan with a reading as the judge writes it ("asked: 1 drone home")."""
    reading = read_asked(reading_text)
    words = _planned(reading_text, moves)
    if reading is None or not reading.readable:
        return OrderComparison(words, None)
    return OrderComparison(words, gaps(moves, reading))


def compared_grammar(
    opening: str, moves: PlanMoves, rule_ids: Sequence[str] = (), *, executed: bool = False
) -> str:
    """Return the grammar of a whole verdict that begins with `opening`.

    A plan that differs from the reading cannot get a Success. The model writes the comparison if
    the console cannot make it, names the violated rules among `rule_ids`, and states the outcome of
    a plan that was `executed`.
    """
    reading_text = opening.partition(': "')[2].removesuffix(PLANNED)
    compared = compare_with_order(reading_text, moves)
    comparison = exactly((reading_text + PLANNED + compared.words)[:COMPARED_CHARS])
    if compared.gaps is None:
        comparison += f"{WORD}+"
    elif executed and not compared.gaps:
        comparison += f"; {WORD}+"
    verdicts = ("Failure",) if compared.gaps else ("Success", "Failure")
    return compact_judge_grammar(rule_ids, comparison, verdicts, COMPARED_CHARS)


def _planned(reading_text: str, moves: PlanMoves) -> str:
    """Return the planned actions in words, with names of assets if the reading has them."""
    actions, world = moves.plan.actions, moves.world
    by_name = any(name in reading_text for name in world.assets)
    words = planned(actions, world, by_name=by_name)
    if len(words) > MOST_PLANNED:
        words = planned(actions, world, by_name=False)[:MOST_PLANNED]
    return json.dumps(words)[1:-1]


@dataclass(frozen=True)
class PlanCase:
    """A plan for `task`, with the rules and the picture from which the planner made it.

    `asked` is the reading that the operator confirmed; '' if the judge reads the order.
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
    """Return the question to the judge whether the plan serves the task within the rules (step 6).

    Raises KeyError if a rule that was retrieved or broken is not in `rulebook`.
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
    """Return the ids of the retrieved rules that apply to the plan, and of every broken rule."""
    findings = [finding for finding in findings if finding.rule_id != ORDER_ID]
    by_rule = {finding.rule_id: finding for finding in findings}
    ids = [
        hit.rule_id
        for hit in hits
        if hit.rule_id not in by_rule or by_rule[hit.rule_id].status != "not_applicable"
    ]
    return ids + [f.rule_id for f in findings if f.broken and f.rule_id not in ids]


async def judge(context: MissionContext, planned: PlanForDecision) -> PlanForDecision:
    """Ask the judge for its verdict, and make a plan for the likeliest reading (step 6).

    A trained judge reads the order by itself; the second reader reads an order that is in doubt.
    Readings that are likelier than the planner's are tried in turn. The first that has an
    acceptable plan replaces the planner's reading and plan.
    """
    answered, shown = planned.answered, await _judged(context, planned.answered, planned.best)
    rehearsal = shown.examination.rehearsal
    if shown.own or answered.retrieved.chosen or shown.examination.blocked or rehearsal is None:
        return replace(planned, best=shown)
    case, services = _case(answered, shown, rehearsal), context.services
    question = ask_about_plan(services.prompt_format, services.fleet.world, services.rulebook, case)
    readings = await read_order(context, answered, shown, question)
    own = next(reading for reading in readings if reading.reader == "planner")
    for reading in readings[: readings.index(own)]:
        if may_decide(services.variant, reading, own):
            other = await _taken_instead(context, answered, shown, reading)
            if other is not None:
                return PlanForDecision(answered, other, readings, reading)
    return PlanForDecision(answered, shown, readings, own)


async def _taken_instead(
    context: MissionContext, answered: PlannerAnswer, shown: Candidate, reading: WeighedReading
) -> Candidate | None:
    """Return a plan for a likelier `reading`; None if there is no acceptable plan for it.

    No rule may block the plan, and the judge must accept it for that reading. The reading may leave
    words of the order unused only if the reading of the plan `shown` does. A plan that moves
    nothing, because no part of its reading can be carried out, does not replace a plan that moves
    assets and leaves nothing out.
    """
    reading_text, reader = reading.asked, reading.reader
    other = await with_commands_given(
        context, answered, reading_text, read_asked(reading_text), shown, reader=reader
    )
    if other is shown or other.examination.blocked:
        return None
    if other.mentions.gaps and not shown.mentions.gaps:
        return None
    if (
        _acts(shown)
        and not _acts(other)
        and not shown.all_gaps
        and _is_in_vain(context, reading_text)
    ):
        return None
    other = await _judged(context, answered, other, reading_text)
    return None if other.objected else other


def verdict_on(steps: Sequence[Candidate]) -> tuple[Verdict | None, str]:
    """Return one verdict for all steps of a plan, or the reason why there is no verdict.

    The verdict is Success only if the judge objects to no step.
    """
    for number, step in enumerate(steps, start=1):
        if step.verdict is None:
            return None, f"step {number}: {step.judge_error or 'no verdict'}"
    verdicts = [step.verdict for step in steps if step.verdict is not None]
    objections = [
        f"step {number}: {verdict.feedback}"
        for number, verdict in enumerate(verdicts, start=1)
        if verdict.verdict == "Failure"
    ]
    feedback = "; ".join(objections or [f"no objection to {len(verdicts)} steps"])
    rules = {opinion.rule_id: opinion for verdict in verdicts for opinion in verdict.rules}
    verdict = Verdict(
        verdict="Failure" if objections else "Success",
        rules=tuple(rules.values()),
        feedback=feedback[:MAX_FEEDBACK],
    )
    return verdict, ""


def _acts(candidate: Candidate) -> bool:
    return any(action.verb not in STILL for action in candidate.examination.plan.actions)


def _is_in_vain(context: MissionContext, reading_text: str) -> bool:
    """Return whether no part of a reading can be carried out, although no part is refused."""
    reading, fleet = read_asked(reading_text), context.services.fleet
    if reading is None or not reading.asks or any(ask.task == "refused" for ask in reading.asks):
        return False
    return all(obstacle_to(ask, fleet.world, fleet.picture()) for ask in reading.asks)


async def _judged(
    context: MissionContext, answered: PlannerAnswer, candidate: Candidate, chosen: str = ""
) -> Candidate:
    """Return `candidate` with the judge's verdict on its plan.

    The judge reads the order unless `chosen` is given. If a judge on a server returns no verdict,
    the local model judges instead.
    """
    examination, services, attempt = candidate.examination, context.services, candidate.attempt
    if examination.blocked or examination.rehearsal is None or not services.variant.judging:
        return candidate
    case = _case(answered, candidate, examination.rehearsal, chosen)

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
        candidate, verdict=judgement.verdict, judge_error=judgement.error, judge_confidence=sure
    )


def _case(
    answered: PlannerAnswer, candidate: Candidate, rehearsal: Rehearsal, chosen: str = ""
) -> PlanCase:
    examination, question = candidate.examination, answered.question
    return PlanCase(
        answered.retrieved.task,
        answered.retrieved.hits,
        question.digest,
        examination.plan,
        examination.findings,
        rehearsal,
        chosen or question.asked,
    )
