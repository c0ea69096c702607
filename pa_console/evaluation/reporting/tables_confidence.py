"""What is left to doubt: success where the models were sure how they had read the command.

Selective classification: coverage, and success among what is covered (R. El-Yaniv and Y. Wiener,
"On the Foundations of Noise-free Selective Classification", JMLR 11 (2010) 1605-1641).
"""

from pa_console.evaluation.record import RunRecord
from pa_console.evaluation.reporting.record_groups import Records, by_model, main_runs
from pa_console.evaluation.reporting.statistics import Rate
from pa_console.evaluation.reporting.table import Table, rate_cell
from pa_console.schema.event import UNSURE

LEVELS = (UNSURE, 0.7, 0.9)


def confidence_tables(records: Records) -> list[Table]:
    """Return success by confidence, of the models that tell theirs; no table without any."""
    rows: list[tuple[str, ...]] = []
    for model, runs in by_model(main_runs(records)).items():
        told = [run for run in runs if run.confidence is not None]
        rows += [_row(model, level, told) for level in LEVELS if told]
    table = Table(
        name="confidence",
        title="Success by confidence in what was asked",
        columns=(
            "Model", "sure from", "sure", "strict where sure", "strict where not",
            "sure and passed by the judge", "strict of these",
        ),
        rows=tuple(rows),
        note=(
            "Confidence: the chance that planner and judge gave to the words in which they say "
            "what was asked, the lower of the two. The operator is warned below "
            f"{UNSURE:.0%}. Runs without confidence, where neither says what was asked, are left "
            "out."
        ),
    )  # fmt: skip
    return [table] if rows else []


def _row(model: str, level: float, told: Records) -> tuple[str, ...]:
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
