"""Calibration of confidence: the share of orders understood, by the confidence of their reading.

Selective classification: coverage, and success among what is covered (R. El-Yaniv and Y. Wiener,
"On the Foundations of Noise-free Selective Classification", JMLR 11 (2010) 1605-1641). Expected
calibration error: the distance between confidence and success, by bins of equal width, weighted by
their runs (C. Guo, G. Pleiss, Y. Sun, K. Q. Weinberger, "On Calibration of Modern Neural Networks",
ICML 2017).
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from pa_console.evaluation.reporting.figure_drawing import (
    GRID,
    INK,
    SERIES,
    legend,
    new_figure,
    percent_axis,
    percent_interval,
)
from pa_console.evaluation.reporting.record_groups import Records, by_model, main_runs
from pa_console.evaluation.reporting.statistics import Rate
from pa_console.evaluation.reporting.table import Table, rate_cell
from pa_console.evaluation.runs.run_record import RunRecord
from pa_console.session.confidence import UNSURE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LEVELS = (0.5, UNSURE, 0.9)
BINS = 10
"""The number of bins of equal width for confidence."""


class Bin(NamedTuple):
    """The runs whose confidence is between two bounds: from `low` on, below `low` + 1 / BINS."""

    low: float
    confidence: float
    """The mean confidence of the runs."""
    strict: Rate


def confidence_and_success(records: Records) -> list[tuple[float, bool]]:
    """Return confidence and strict success of every run that has a confidence."""
    return [(run.confidence, run.strict) for run in records if run.confidence is not None]


def reliability(told: Sequence[tuple[float, bool]]) -> list[Bin]:
    """Return the bins that hold a run, the least confidence first."""
    bins: dict[int, list[tuple[float, bool]]] = {}
    for confidence, strict in told:
        bins.setdefault(min(int(confidence * BINS), BINS - 1), []).append((confidence, strict))
    return [
        Bin(
            number / BINS,
            sum(confidence for confidence, _ in runs) / len(runs),
            Rate.of(strict for _, strict in runs),
        )
        for number, runs in sorted(bins.items())
    ]


def calibration_error(told: Sequence[tuple[float, bool]]) -> float | None:
    """Return the expected calibration error, 0 to 1; None without any run."""
    apart = [
        abs(found.confidence - (found.strict.value or 0.0)) * found.strict.runs
        for found in reliability(told)
    ]
    return sum(apart) / len(told) if told else None


def calibration_tables(records: Records) -> list[Table]:
    """Return the reliability of each model's confidence; no table without any."""
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
            whole = Rate.of(strict for _, strict in told)
            mean = sum(confidence for confidence, _ in told) / len(told)
            rows.append((model, "all", f"{mean:.1%}", rate_cell(whole), f"{error:.3f}"))
    table = Table(
        name="calibration",
        title="Calibration: confidence against success",
        columns=("Model", "confidence", "mean", "strict", "calibration error"),
        rows=tuple(rows),
        note=(
            "Strict: of the runs with such a confidence, those that succeeded. Calibration error: "
            "the expected one, over bins of a tenth; 0 where confidence says how often the order "
            "was understood. A run fails for other reasons too, which confidence does not know."
        ),
    )
    return [table] if rows else []


def reliability_diagram(records: Records) -> "Figure":
    """Draw strict success against confidence, a line for every model, with 95 % intervals."""
    figure, (ax,) = new_figure(4.6, 4.0)
    ax.plot([0, 100], [0, 100], color=INK, linewidth=0.8, linestyle="--", label="as sure as right")
    shapes = "os^Dv"
    for number, (model, runs) in enumerate(by_model(main_runs(records)).items()):
        bins = reliability(confidence_and_success(runs))
        points = [
            (100 * found.confidence, *interval)
            for found in bins
            if (interval := percent_interval(found.strict)) is not None
        ]
        colour = SERIES[number % len(SERIES)]
        ax.errorbar(
            [x for x, *_ in points],
            [y for _, y, _, _ in points],
            yerr=[[y - low for _, y, low, _ in points], [high - y for _, y, _, high in points]],
            fmt=f"{shapes[number % len(shapes)]}-", color=colour, ecolor=colour, label=model,
            ms=5.0, mec=INK, mew=0.4, linewidth=1.0, elinewidth=1.0, capsize=2,
        )  # fmt: skip
    ax.set_xlim(-4, 104)
    ax.set_xlabel("confidence, %")
    percent_axis(ax, "strict success, %")
    ax.grid(axis="x", color=GRID)
    legend(figure, ax, 3)
    return figure


def confidence_tables(records: Records) -> list[Table]:
    """Return success by confidence, for models that report one; no table without any."""
    rows: list[tuple[str, ...]] = []
    for model, runs in by_model(main_runs(records)).items():
        told = [run for run in runs if run.confidence is not None]
        rows += [_confidence_row(model, level, told) for level in LEVELS if told]
    table = Table(
        name="confidence",
        title="Success by confidence in what was asked",
        columns=(
            "Model", "sure from", "sure", "strict where sure", "strict where not",
            "sure and passed by the judge", "strict of these",
        ),
        rows=tuple(rows),
        note=(
            "Confidence: how often an order that was read so is right, as the operator was told. "
            f"The operator is warned below {UNSURE:.0%}. Runs without confidence, where neither "
            "says what was asked, are left out."
        ),
    )  # fmt: skip
    return [table] if rows else []


def _confidence_row(model: str, level: float, told: Records) -> tuple[str, ...]:
    sure = [run for run in told if _is_sure(run, level)]
    passed = [run for run in sure if run.judge_plan != "Failure"]
    rates = (
        Rate(len(sure), len(told)),
        Rate.of(run.strict for run in sure),
        Rate.of(run.strict for run in told if run not in sure),
        Rate(len(passed), len(told)),
        Rate.of(run.strict for run in passed),
    )
    return model, f"{level:.0%}", *map(rate_cell, rates)


def _is_sure(run: RunRecord, level: float) -> bool:
    return run.confidence is not None and run.confidence >= level
