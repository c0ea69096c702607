"""The tables of judgement: judge and telemetry against the truth (Fig. 5), readings, confidence.

The tables of confidence show coverage and success in selective classification (R. El-Yaniv and
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
    rate_cell,
    table_of,
    table_of_rows,
)
from pa_console.evaluation.run_record import Opinion, RunRecord
from pa_console.schema.evaluation import Expectation
from pa_console.session.confidence import UNSURE

VerdictSource = Literal["judge, plan", "judge, outcome", "telemetry"]


def _telemetry(record: RunRecord) -> Opinion | None:
    if record.verification == "pass":
        return "Success"
    return "Failure" if record.verification == "fail" else None


JUDGEMENTS: dict[VerdictSource, Callable[[RunRecord], Opinion | None]] = {
    "judge, plan": lambda record: record.judge_plan,
    "judge, outcome": lambda record: record.judge_outcome,
    "telemetry": _telemetry,
}
"""The sources of a judgement on a run's success, and the judgement of each on a run."""


CHOOSING = frozenset(name for name, variant in VARIANTS.items() if variant.reading)
"""The variants in which the operator chooses another reading."""

LEVELS = (0.5, UNSURE, 0.9)
"""The levels of confidence in the table."""
BINS = 10
"""The number of bins of equal width for confidence."""


def confusion(records: Records, judgement: VerdictSource) -> Confusion:
    """Return the counts of `judgement` on `records` against strict success."""
    says = JUDGEMENTS[judgement]
    return Confusion.of((says(record), record.strict) for record in records)


def judge_tables(records: Records) -> list[ReportTable]:
    """Return Fig. 5 for the paper's missions and for all missions, and the table of refusals."""
    main, paper = main_runs(records), comparable_runs(records)
    tables = [_figure_five(paper)] if paper else []
    if len(paper) < len(main):
        tables.append(_judged(main, "judge-all"))
    tables.append(_refusals(main))
    return [table for table in tables if table.rows]


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
    """Return the rate of refusals among the commands that must be refused."""
    return SuccessRate.of(record.refused for record in records if record.expect == "refuse")


def refusal_precision(records: Records) -> SuccessRate:
    """Return the rate of necessary refusals among all necessary and needless ones."""
    right = sum(record.refused for record in records if record.expect == "refuse")
    return SuccessRate(right, right + sum(needless_refusal(record) for record in records))


def over_refusal(records: Records, *expected: Expectation, tag: str = "") -> SuccessRate:
    """Return the rate of needless refusals among runs with an `expected` result and `tag`."""
    return SuccessRate.of(
        needless_refusal(record)
        for record in records
        if record.expect in expected and (not tag or tag in record.tags)
    )


def _refusals(records: Records) -> ReportTable:
    columns: dict[str, Callable[[Records], SuccessRate]] = {
        "recall": refusal_recall,
        "precision": refusal_precision,
        "refused: to be carried out": lambda runs: over_refusal(runs, "execute"),
        "refused: to be trimmed": lambda runs: over_refusal(runs, "trim"),
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


def reading_tables(records: Records) -> list[ReportTable]:
    """Return the table of success before and after a choice among readings, if there were any."""
    rows: list[tuple[str, ...]] = []
    chosen = by_model([record for record in records if record.variant in CHOOSING])
    for model, runs in by_model(main_runs(records)).items():
        if model in chosen:
            rows.append(_readings_row(model, runs, chosen[model]))
    table = table_of_rows(
        "readings",
        (
            "Model", "offered", "strict as read first", "strict as read or as one offered",
            "strict of all, the right one chosen",
        ),
        rows,
    )  # fmt: skip
    return [table] if rows else []


def _readings_row(model: str, runs: Records, chosen: Records) -> tuple[str, ...]:
    others = grouped(chosen, lambda run: run.case)
    offered = [run for run in runs if run.offered and run.case in others]

    def right(run: RunRecord) -> bool:
        again = others[run.case] if run.offered and run.case in others else ()
        return run.strict or any(other.strict for other in again)

    rates = (
        SuccessRate(len(offered), len(runs)),
        SuccessRate.of(run.strict for run in offered),
        SuccessRate.of(map(right, offered)),
        SuccessRate.of(map(right, runs)),
    )
    return model, *map(rate_cell, rates)


class Bin(NamedTuple):
    """The runs with a confidence of at least `low` and below `low` + 1 / BINS."""

    low: float
    confidence: float
    """The mean confidence of the runs."""
    strict: SuccessRate


def confidence_and_success(records: Records) -> list[tuple[float, bool]]:
    """Return confidence and strict success of each run with a confidence."""
    return [(run.confidence, run.strict) for run in records if run.confidence is not None]


def reliability(told: Sequence[tuple[float, bool]]) -> list[Bin]:
    """Return the bins with at least one run, the lowest confidence first."""
    bins: dict[int, list[tuple[float, bool]]] = {}
    for confidence, strict in told:
        bins.setdefault(min(int(confidence * BINS), BINS - 1), []).append((confidence, strict))
    return [
        Bin(
            number / BINS,
            sum(confidence for confidence, _ in runs) / len(runs),
            SuccessRate.of(strict for _, strict in runs),
        )
        for number, runs in sorted(bins.items())
    ]


def calibration_error(told: Sequence[tuple[float, bool]]) -> float | None:
    """Return the expected calibration error, 0 to 1; None if there are no runs."""
    apart = [
        abs(found.confidence - (found.strict.value or 0.0)) * found.strict.runs
        for found in reliability(told)
    ]
    return sum(apart) / len(told) if told else None


def calibration_tables(records: Records) -> list[ReportTable]:
    """Return the table of the reliability of each model's confidence, if any was reported."""
    rows: list[tuple[str, ...]] = []
    for model, runs in by_model(main_runs(records)).items():
        told = confidence_and_success(runs)
        error = calibration_error(told)
        rows += [
            (
                model,
                f"{found.low:.0%} to {found.low + 1 / BINS:.0%}",
                f"{found.confidence:.1%}",
                rate_cell(found.strict),
                "",
            )
            for found in reliability(told)
        ]
        if error is not None:
            whole = SuccessRate.of(strict for _, strict in told)
            mean = sum(confidence for confidence, _ in told) / len(told)
            rows.append((model, "all", f"{mean:.1%}", rate_cell(whole), f"{error:.3f}"))
    table = table_of_rows(
        "calibration", ("Model", "confidence", "mean", "strict", "calibration error"), rows
    )
    return [table] if rows else []


def confidence_tables(records: Records) -> list[ReportTable]:
    """Return the table of success by confidence, if any model reported a confidence."""
    rows: list[tuple[str, ...]] = []
    for model, runs in by_model(main_runs(records)).items():
        told = [run for run in runs if run.confidence is not None]
        rows += [_confidence_row(model, level, told) for level in LEVELS if told]
    table = table_of_rows(
        "confidence",
        (
            "Model", "sure from", "sure", "strict where sure", "strict where not",
            "sure and passed by the judge", "strict of these",
        ),
        rows,
        unsure=UNSURE,
    )  # fmt: skip
    return [table] if rows else []


def _confidence_row(model: str, level: float, told: Records) -> tuple[str, ...]:
    sure = [run for run in told if _is_sure(run, level)]
    passed = [run for run in sure if run.judge_plan != "Failure"]
    rates = (
        SuccessRate(len(sure), len(told)),
        SuccessRate.of(run.strict for run in sure),
        SuccessRate.of(run.strict for run in told if run not in sure),
        SuccessRate(len(passed), len(told)),
        SuccessRate.of(run.strict for run in passed),
    )
    return model, f"{level:.0%}", *map(rate_cell, rates)


def _is_sure(run: RunRecord, level: float) -> bool:
    return run.confidence is not None and run.confidence >= level
