"""Asks a model for its verdict on executed plans, and says how good the verdicts are."""

from collections import Counter
from collections.abc import AsyncGenerator, Callable, Iterable, Sequence
from dataclasses import replace

from pa_console.evaluation.reporting.statistics import Confusion, SuccessRate, spread
from pa_console.evaluation.run_record import Opinion
from pa_console.llm.models.catalogue import LocalModel
from pa_console.llm.roles.judge import Judge, JudgeQuestion
from pa_console.llm.roles.role_model import PROMPT_FORMATS
from pa_console.mission.judge import ask_about_plan
from pa_console.mission.verify import ask_about_outcome
from pa_console.schema.base import StrictModel
from pa_console.schema.finding import Verdict
from tests.benchmarks.judge.cases import JudgedCase


class JudgeAnswer(StrictModel):
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
    plan: JudgeAnswer
    outcome: JudgeAnswer | None = None
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
    prompt_format = PROMPT_FORMATS[model.prompts]
    for case in cases:
        before = await _answer(
            judge, ask_about_plan(prompt_format, case.world, case.rulebook, case.plan)
        )
        after = None
        if outcomes and case.after is not None:
            executed = replace(case.after, feedback=before.feedback)
            after = await _answer(judge, ask_about_outcome(prompt_format, case.world, executed))
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


async def _answer(judge: Judge, question: JudgeQuestion) -> JudgeAnswer:
    judgement = await judge.judge(question)
    verdict = judgement.verdict
    rules = verdict.rules if verdict is not None else ()
    return JudgeAnswer(
        verdict=_opinion(verdict),
        feedback=verdict.feedback if verdict is not None else "",
        violated=tuple(rule.rule_id for rule in rules if rule.opinion == "violates"),
        error=judgement.error,
        seconds=judgement.usage.seconds,
    )


def _is_own(case: JudgedCase, model: LocalModel) -> bool:
    """Whether weights and adapters of the planner are those of the model under test."""
    adapters = {adapter.sha256 for adapter in model.adapters}
    return (case.planner_sha256, case.adapters) == (model.sha256, adapters)


def _opinion(verdict: Verdict | None) -> Opinion | None:
    return verdict.verdict if verdict is not None else None


class Share(StrictModel):
    """A figure between 0 and 1 with the ends of its 95 % interval."""

    value: float
    low: float
    high: float


class Class(StrictModel):
    """How well one of the two verdicts is given; None where nothing was of its kind."""

    precision: Share | None
    recall: Share | None
    f1: Share | None


class Quality(StrictModel):
    """The verdicts on some runs against the truth; positive is Success.

    `silent` runs had no verdict and are in no rate. Seconds are the model's own, per verdict.
    """

    name: str
    runs: int
    tp: int
    fp: int
    fn: int
    tn: int
    silent: int
    accuracy: Share | None
    success: Class
    failure: Class
    median_s: float | None = None
    p95_s: float | None = None


class JudgeReport(StrictModel):
    """Everything that a bench of one judge found."""

    model: str
    fingerprint: str
    prompt_format: str
    folder: str
    planners: tuple[str, ...]
    left_out: dict[str, int]
    changed: int
    """Runs whose world or rules were another file than now."""
    own_plans: int
    asked: int
    reused: int
    total: tuple[Quality, ...]
    categories: tuple[Quality, ...]
    by_planner: tuple[Quality, ...]
    errors: dict[str, int]
    runs: tuple[JudgedRun, ...]


def qualities(
    runs: Sequence[JudgedRun],
) -> tuple[tuple[Quality, ...], tuple[Quality, ...], tuple[Quality, ...]]:
    """Return how good the verdicts on all runs were, those by category, and those by planner.

    In all come first the model's own verdicts, then those that the logs hold.
    """
    total = [_plan_quality("plan", runs)]
    afterwards = [run for run in runs if run.outcome is not None]
    if afterwards:
        outcomes = [run.outcome for run in afterwards if run.outcome is not None]
        total.append(_quality("outcome", _pairs(outcomes, afterwards), outcomes))
    if any(run.logged_plan for run in runs):
        total.append(_quality("plan, as logged", [(r.logged_plan, r.strict) for r in runs]))
    if any(run.logged_outcome for run in runs):
        total.append(_quality("outcome, as logged", [(r.logged_outcome, r.strict) for r in runs]))
    return (
        tuple(total),
        _by(runs, lambda run: run.category),
        _by(runs, lambda run: run.planner),
    )


def errors_of(runs: Iterable[JudgedRun]) -> dict[str, int]:
    """Count the reasons why there was no verdict."""
    said = [answer.error for run in runs for answer in (run.plan, run.outcome) if answer]
    return dict(Counter(error for error in said if error).most_common())


def _by(runs: Sequence[JudgedRun], key: Callable[[JudgedRun], str]) -> tuple[Quality, ...]:
    groups: dict[str, list[JudgedRun]] = {}
    for run in runs:
        groups.setdefault(key(run), []).append(run)
    return tuple(_plan_quality(name, groups[name]) for name in sorted(groups))


def _plan_quality(name: str, runs: Sequence[JudgedRun]) -> Quality:
    answers = [run.plan for run in runs]
    return _quality(name, _pairs(answers, runs), answers)


def _pairs(
    answers: Sequence[JudgeAnswer], runs: Sequence[JudgedRun]
) -> list[tuple[Opinion | None, bool]]:
    return [(answer.verdict, run.strict) for answer, run in zip(answers, runs, strict=True)]


def _quality(
    name: str, pairs: Sequence[tuple[Opinion | None, bool]], answers: Sequence[JudgeAnswer] = ()
) -> Quality:
    found = Confusion.of(pairs)
    seconds = spread([answer.seconds for answer in answers])
    return Quality(
        name=name,
        runs=len(pairs),
        tp=found.tp,
        fp=found.fp,
        fn=found.fn,
        tn=found.tn,
        silent=found.silent,
        accuracy=_share(SuccessRate(found.tp + found.tn, found.judged)),
        success=_class(found),
        failure=_class(Confusion(found.tn, found.fn, found.fp, found.tp, found.silent)),
        median_s=seconds.median if seconds is not None else None,
        p95_s=seconds.p95 if seconds is not None else None,
    )


def _class(found: Confusion) -> Class:
    f1 = found.f1
    return Class(
        precision=_share(found.precision),
        recall=_share(found.recall),
        f1=Share(value=f1[0], low=f1[1], high=f1[2]) if f1 is not None else None,
    )


def _share(rate: SuccessRate) -> Share | None:
    if rate.value is None:
        return None
    return Share(value=rate.value, low=rate.low, high=rate.high)
