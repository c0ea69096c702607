"""How good a judge's verdicts are: what they say against the strict truth of the runs."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence

from pa_console.evaluation.judge_bench import Answer, JudgedRun
from pa_console.evaluation.record import Opinion
from pa_console.evaluation.reporting.statistics import Confusion, Rate, spread
from pa_console.schema.base import StrictModel


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
    dialect: str
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
    answers: Sequence[Answer], runs: Sequence[JudgedRun]
) -> list[tuple[Opinion | None, bool]]:
    return [(answer.verdict, run.strict) for answer, run in zip(answers, runs, strict=True)]


def _quality(
    name: str, pairs: Sequence[tuple[Opinion | None, bool]], answers: Sequence[Answer] = ()
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
        accuracy=_share(Rate(found.tp + found.tn, found.judged)),
        success=_class(found),
        failure=_class(found.flipped),
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


def _share(rate: Rate) -> Share | None:
    if rate.value is None:
        return None
    return Share(value=rate.value, low=rate.low, high=rate.high)
