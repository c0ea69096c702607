"""Asks a model for its verdict on plans that were executed in an evaluation."""

from collections.abc import AsyncGenerator, Iterable
from dataclasses import replace

from pa_console.evaluation.judge_cases import JudgedCase
from pa_console.evaluation.record import Opinion
from pa_console.llm.catalog import LocalModel
from pa_console.llm.dialect import DIALECTS
from pa_console.llm.judge import Judge, Judgement
from pa_console.orchestrator.judging import JudgeQuestion, ask_about_outcome, ask_about_plan
from pa_console.schema.base import StrictModel
from pa_console.schema.finding import Verdict


class Answer(StrictModel):
    """One verdict on one run; `verdict` None means that none could be had, `error` says why."""

    verdict: Opinion | None
    feedback: str = ""
    violated: tuple[str, ...] = ()
    error: str = ""
    seconds: float = 0.0


class JudgedRun(StrictModel):
    """What a run truly came to, and what was said of it before and after it was executed.

    `logged_plan` and `logged_outcome` are the verdicts of the judge that the evaluation had.
    """

    run: str
    planner: str
    variant: str
    category: str
    strict: bool
    plan: Answer
    outcome: Answer | None = None
    logged_plan: Opinion | None = None
    logged_outcome: Opinion | None = None
    own_plan: bool = False
    """Whether the model under test made the plan itself."""


async def judge_cases(
    cases: Iterable[JudgedCase], judge: Judge, model: LocalModel, *, outcomes: bool = True
) -> AsyncGenerator[JudgedRun]:
    """Yield what `judge`, whose model is `model`, says of each case; it is told no truth.

    Without `outcomes` it is not asked what came of the plans.
    """
    dialect = DIALECTS[model.prompts]
    for case in cases:
        before = await _answer(judge, ask_about_plan(dialect, case.world, case.rulebook, case.plan))
        after = None
        if outcomes and case.after is not None:
            executed = replace(case.after, said=before.feedback)
            after = await _answer(judge, ask_about_outcome(dialect, case.world, executed))
        logged_plan, logged_outcome = map(_opinion, case.logged)
        yield JudgedRun(
            run=case.record.run,
            planner=case.record.model,
            variant=case.record.variant,
            category=case.record.category,
            strict=case.record.strict,
            plan=before,
            outcome=after,
            logged_plan=logged_plan,
            logged_outcome=logged_outcome,
            own_plan=_is_own(case, model),
        )


async def _answer(judge: Judge, question: JudgeQuestion) -> Answer:
    async for item in question.put_to(judge):
        if isinstance(item, Judgement):
            verdict = item.verdict
            rules = verdict.rules if verdict is not None else ()
            return Answer(
                verdict=_opinion(verdict),
                feedback=verdict.feedback if verdict is not None else "",
                violated=tuple(rule.rule_id for rule in rules if rule.opinion == "violates"),
                error=item.error,
                seconds=item.usage.seconds,
            )
    raise RuntimeError("the judge ended without a judgement")


def _is_own(case: JudgedCase, model: LocalModel) -> bool:
    """Whether weights and adapters of the planner are those of the model under test."""
    adapters = {adapter.sha256 for adapter in model.adapters}
    return (case.planner_sha256, case.adapters) == (model.sha256, adapters)


def _opinion(verdict: Verdict | None) -> Opinion | None:
    return verdict.verdict if verdict is not None else None
