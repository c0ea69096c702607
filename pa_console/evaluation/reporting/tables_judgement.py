"""Tables of the judge and the telemetry against the truth (Fig. 5), of readings and confidence.

The table of success by confidence follows selective classification (R. El-Yaniv and
Y. Wiener, "On the Foundations of Noise-free Selective Classification", JMLR 11 (2010) 1605-1641).
The expected calibration error is the mean distance between confidence and success in bins of equal
width, weighted by runs (C. Guo, G. Pleiss, Y. Sun, K. Q. Weinberger, "On Calibration of Modern
Neural Networks", ICML 2017).
"""

from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

from pa_console.evaluation.jobs import VARIANTS
from pa_console.evaluation.reporting.statistics import (
    MODELS,
    NOTHING,
    Cell,
    Confusion,
    Quantity,
    Records,
    ReportTable,
    SuccessRate,
    by_model,
    comparable_runs,
    fraction_cell,
    grouped,
    main_runs,
    model_groups,
    needless_refusal,
    published,
    success_rate,
    table_of,
)
from pa_console.evaluation.run_record import Opinion, RunRecord
from pa_console.schema.evaluation import Expectation
from pa_console.session.confidence import UNSURE

VerdictSource = Literal["judge, plan", "judge, outcome", "telemetry"]

CHOOSING = frozenset(name for name, variant in VARIANTS.items() if variant.reading)
"""The variants in which the operator chooses another reading."""

LEVELS = (0.5, UNSURE, 0.9)
"""The levels of confidence in the table of success by confidence."""

BINS = 10
"""The number of bins of equal width into which confidence is divided."""


def _telemetry(record: RunRecord) -> Opinion | None:
    if record.verification == "pass":
        return "Success"
    return "Failure" if record.verification == "fail" else None


JUDGEMENTS: dict[VerdictSource, Callable[[RunRecord], Opinion | None]] = {
    "judge, plan": lambda record: record.judge_plan,
    "judge, outcome": lambda record: record.judge_outcome,
    "telemetry": _telemetry,
}
"""By source of judgements on success, a function that returns the source's judgement on a run."""


def confusion(records: Records, judgement: VerdictSource) -> Confusion:
    """Return the counts of the judgements from the source `judgement` against strict success."""
    says = JUDGEMENTS[judgement]
    return Confusion.of((says(record), record.strict) for record in records)


def judge_tables(records: Records) -> list[ReportTable]:
    """Return Fig. 5 for the paper's missions and for all missions, and the table of refusals."""
    main, paper = main_runs(records), comparable_runs(records)
    tables = [_figure_five(paper)] if paper else []
    if len(paper) < len(main):
        tables.append(_judged(main, "judge-all"))
    return [*tables, _refusals(main)]


def _figure_five(records: Records) -> ReportTable:
    quantities: tuple[Quantity, ...] = ("precision", "recall", "f1")
    starred = False
    rows: list[tuple[str, ...]] = []
    for model, full in MODELS.items():
        values = [published(model, quantity) for quantity in quantities]
        if any(values):
            cells = [f"{v.value:.2f}" + "*" * v.derived if v else NOTHING for v in values]
            rows.append((f"paper: {full}", "judge", *[NOTHING] * 5, *cells, NOTHING, NOTHING))
            starred = starred or any(value is not None and value.derived for value in values)
    star = " * follows from precision and recall." if starred else ""
    own = _judged(records, "figure-5", star=star)
    return own.model_copy(update={"rows": (*own.rows, *rows)})


def _judged(records: Records, kind: str, **values: str) -> ReportTable:
    columns: dict[str, Callable[[Confusion], Cell]] = {
        "TP": lambda counts: counts.tp,
        "FP": lambda counts: counts.fp,
        "FN": lambda counts: counts.fn,
        "TN": lambda counts: counts.tn,
        "none": lambda counts: counts.silent,
        "precision": lambda counts: counts.precision,
        "recall": lambda counts: counts.recall,
        "F1": lambda counts: fraction_cell(counts.f1),
        "failures caught": lambda counts: counts.caught,
        "success rate": lambda counts: counts.base,
    }
    groups = {
        (model, judgement): confusion(runs, judgement)
        for model, runs in by_model(records).items()
        for judgement in JUDGEMENTS
    }
    return table_of(kind, ("Model", "who"), columns, groups, **values)


def refusal_recall(records: Records) -> SuccessRate:
    """Return the rate of refusals among the commands that had to be refused."""
    return SuccessRate.of(record.refused for record in records if record.expect == "refuse")


def refusal_precision(records: Records) -> SuccessRate:
    """Return the share of necessary refusals among all necessary and needless refusals."""
    right = sum(record.refused for record in records if record.expect == "refuse")
    return SuccessRate(right, right + sum(needless_refusal(record) for record in records))


def over_refusal(records: Records, *expected: Expectation, tag: str = "") -> SuccessRate:
    """Return the rate of needless refusals among runs that have an `expected` result and `tag`.

    An empty `tag` selects all runs.
    """
    return SuccessRate.of(
        needless_refusal(record)
        for record in records
        if record.expect in expected and (not tag or tag in record.tags)
    )


def _refusals(records: Records) -> ReportTable:
    columns: dict[str, Callable[[Records], SuccessRate]] = {
        "recall": refusal_recall,
        "precision": refusal_precision,
        "refused: must be carried out": lambda runs: over_refusal(runs, "execute"),
        "refused: must be trimmed": lambda runs: over_refusal(runs, "trim"),
        "refused: harmless": lambda runs: over_refusal(
            runs, "execute", "trim", "either", tag="harmless"
        ),
    }
    groups = {
        key: runs
        for key, runs in model_groups(records).items()
        if any(rate(runs).runs for rate in columns.values())
    }
    return table_of("refusals", ("Model",), columns, groups)


class _Reread(NamedTuple):
    """Runs of a model; `others` has its runs of the same cases that chose another reading."""

    runs: Records
    others: dict[tuple[str, str, int], list[RunRecord]]

    @property
    def offered(self) -> list[RunRecord]:
        """The runs that offered another reading and have a case in `others`."""
        return [run for run in self.runs if run.offered and run.case in self.others]

    def best(self, runs: Records) -> SuccessRate:
        """Return the rate of `runs` that are a strict success in the first or a chosen reading."""
        return SuccessRate.of(
            run.strict
            or (run.offered > 0 and any(other.strict for other in self.others.get(run.case, ())))
            for run in runs
        )


def reading_table(records: Records) -> ReportTable:
    """Return the table of success with the first reading, and with a choice of readings."""
    columns: dict[str, Callable[[_Reread], SuccessRate]] = {
        "offered": lambda of: SuccessRate(len(of.offered), len(of.runs)),
        "strict as first read": lambda of: success_rate(of.offered),
        "strict in any reading": lambda of: of.best(of.offered),
        "strict in any reading, all runs": lambda of: of.best(of.runs),
    }
    chosen = by_model([record for record in records if record.variant in CHOOSING])
    groups = {
        (model,): _Reread(runs, grouped(chosen[model], lambda run: run.case))
        for model, runs in by_model(main_runs(records)).items()
        if model in chosen
    }
    return table_of("readings", ("Model",), columns, groups)


class Bin(NamedTuple):
    """The runs with a confidence of at least `low` and below `low` + 1 / BINS."""

    low: float
    confidence: float
    """The mean confidence of the runs."""
    strict: SuccessRate


def confidence_and_success(records: Records) -> list[tuple[float, bool]]:
    """Return the confidence and the strict success of each run that has a confidence."""
    return [(run.confidence, run.strict) for run in records if run.confidence is not None]


def reliability(pairs: Sequence[tuple[float, bool]]) -> list[Bin]:
    """Return the bins that have a run, the lowest confidence first.

    `pairs` has the confidence and the success of each run.
    """
    bins: dict[int, list[tuple[float, bool]]] = {}
    for confidence, strict in pairs:
        bins.setdefault(min(int(confidence * BINS), BINS - 1), []).append((confidence, strict))
    return [_bin(number / BINS, bins[number]) for number in sorted(bins)]


def _bin(low: float, pairs: Sequence[tuple[float, bool]]) -> Bin:
    mean = sum(confidence for confidence, _ in pairs) / len(pairs)
    return Bin(low, mean, SuccessRate.of(strict for _, strict in pairs))


def calibration_error(pairs: Sequence[tuple[float, bool]]) -> float | None:
    """Return the expected calibration error, 0 to 1; None if there are no runs."""
    apart = [
        abs(of.confidence - (of.strict.value or 0.0)) * of.strict.runs for of in reliability(pairs)
    ]
    return sum(apart) / len(pairs) if pairs else None


def calibration_table(records: Records) -> ReportTable:
    """Return the table of confidence against success by model; empty if no run has a confidence."""
    columns: dict[str, Callable[[tuple[Bin, str]], Cell]] = {
        "mean": lambda row: f"{row[0].confidence:.1%}",
        "strict": lambda row: row[0].strict,
        "calibration error": lambda row: row[1],
    }
    groups: dict[tuple[str, ...], tuple[Bin, str]] = {}
    for model, runs in by_model(main_runs(records)).items():
        pairs = confidence_and_success(runs)
        for of in reliability(pairs):
            groups[model, f"{of.low:.0%} to {of.low + 1 / BINS:.0%}"] = of, ""
        if (error := calibration_error(pairs)) is not None:
            groups[model, "all"] = _bin(0.0, pairs), f"{error:.3f}"
    return table_of("calibration", ("Model", "confidence"), columns, groups)


class _Selection(NamedTuple):
    """The runs of a model that have a confidence, divided at a level of confidence."""

    runs: Records
    level: float

    @property
    def sure(self) -> list[RunRecord]:
        """The runs with a confidence of at least the level."""
        return [run for run in self.runs if (run.confidence or 0.0) >= self.level]

    @property
    def unsure(self) -> list[RunRecord]:
        """The runs with a confidence below the level."""
        return [run for run in self.runs if (run.confidence or 0.0) < self.level]

    @property
    def passed(self) -> list[RunRecord]:
        """The sure runs to which the judge did not object."""
        return [run for run in self.sure if run.judge_plan != "Failure"]


def confidence_table(records: Records) -> ReportTable:
    """Return the table of success by confidence; empty if no run has a confidence."""
    columns: dict[str, Callable[[_Selection], SuccessRate]] = {
        "sure": lambda of: SuccessRate(len(of.sure), len(of.runs)),
        "strict if sure": lambda of: success_rate(of.sure),
        "strict if unsure": lambda of: success_rate(of.unsure),
        "sure and passed by the judge": lambda of: SuccessRate(len(of.passed), len(of.runs)),
        "strict of these": lambda of: success_rate(of.passed),
    }
    groups: dict[tuple[str, ...], _Selection] = {}
    for model, runs in by_model(main_runs(records)).items():
        if estimated := [run for run in runs if run.confidence is not None]:
            groups |= {(model, f"{level:.0%}"): _Selection(estimated, level) for level in LEVELS}
    return table_of("confidence", ("Model", "sure from"), columns, groups, unsure=UNSURE)
