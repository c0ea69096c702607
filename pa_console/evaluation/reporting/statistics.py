"""Groups of runs, rates with Wilson intervals, the tables of a report, and the paper's results.

O. Solanki, L. Praharaj, D. Gupta, M. Gupta, "A Policy-Aware Edge LLM-RAG Framework for Internet of
Battlefield Things Mission Orchestration", Section V.
"""

import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from statistics import fmean, median, stdev
from typing import Literal, NamedTuple, TypeVar

import numpy as np
from pydantic import model_validator

from pa_console.evaluation.jobs import REFERENCE
from pa_console.evaluation.run_record import Opinion, RunRecord
from pa_console.schema.base import StrictModel
from pa_console.schema.document import Document

Records = Sequence[RunRecord]
Group = TypeVar("Group")
Key = TypeVar("Key")
Interval = tuple[float, float, float]
"""A value, and the two ends of its interval."""

Z95 = 1.959963984540054
"""The normal quantile of a two-sided interval of 95 %."""

NOTHING = "-"
"""The content of a cell without a value."""

_NUMBER = re.compile(r"[+-]?\d[\d.,]*[%*/]{0,2}( |\d|$)|-$")

Quantity = Literal["hybrid", "strict", "latency_s", "precision", "recall", "f1"]
SuccessKind = Literal["hybrid", "strict", "obeyed"]

MISSION_SET = "paper"
"""The mission set of the paper's ten commands; only its runs are comparable with the paper."""


class PaperFigure(StrictModel):
    """One number of the paper; `derived` is True if it follows from other numbers in the text."""

    value: float
    derived: bool = False


class _Paper(StrictModel):
    """The file `paper.yaml`."""

    models: dict[str, str]
    hybrid_by_category: dict[str, dict[str, float]]
    results: dict[str, dict[str, PaperFigure]]


class TableText(StrictModel):
    """The title and the note of a table."""

    title: str
    note: str


class FigureText(StrictModel):
    """The title of a figure and its description in words."""

    title: str
    alt: str


class _Texts(StrictModel):
    """The file `texts.yaml`."""

    terms: dict[str, str]
    tables: dict[str, TableText]
    figures: dict[str, FigureText]


TEXTS = Document.read(Path(__file__).with_name("texts.yaml")).parse(_Texts)
_PAPER = Document.read(Path(__file__).with_name("paper.yaml")).parse(_Paper)
MODELS, HYBRID_BY_CATEGORY = _PAPER.models, _PAPER.hybrid_by_category


def grouped(records: Records, key: Callable[[RunRecord], Key]) -> dict[Key, list[RunRecord]]:
    """Return the records by `key`; the keys are in the order of their first appearance."""
    groups: dict[Key, list[RunRecord]] = {}
    for record in records:
        groups.setdefault(key(record), []).append(record)
    return groups


def by_model(records: Records) -> dict[str, list[RunRecord]]:
    """Return the records by model."""
    return grouped(records, lambda record: record.model)


def model_groups(records: Records) -> dict[tuple[str, ...], list[RunRecord]]:
    """Return the records by model, in the form of groups for a table."""
    return grouped(records, lambda record: (record.model,))


def by_set(records: Records) -> dict[str, list[RunRecord]]:
    """Return the records by mission set."""
    return grouped(records, lambda record: record.mission_set)


def main_variant(records: Records) -> str:
    """Return the variant for tables by model; "" if there are no runs.

    This is the variant with the most models. If several variants have equally many models, it is
    the reference, or else `full`, or else the variant with the most runs.
    """
    variants = grouped(records, lambda record: record.variant)
    if not variants:
        return ""

    def rank(name: str) -> tuple[int, bool, bool, int]:
        runs = variants[name]
        return len(by_model(runs)), name == REFERENCE, name == "full", len(runs)

    return max(variants, key=rank)


def main_runs(records: Records) -> list[RunRecord]:
    """Return the runs of the main variant."""
    variant = main_variant(records)
    return [record for record in records if record.variant == variant]


def comparable_runs(records: Records) -> list[RunRecord]:
    """Return the runs of the main variant on the paper's own missions."""
    return [record for record in main_runs(records) if record.mission_set == MISSION_SET]


def needless_refusal(record: RunRecord) -> bool:
    """Return whether a command was refused although it had to be carried out, in whole or in part.

    A command that a hold or a report fulfils does not count as refused, because its run is a strict
    success.
    """
    return record.refused and not record.strict and record.expect in ("execute", "trim")


def ablated_models(records: Records) -> list[str]:
    """Return the models with runs in two or more variants."""
    pairs = {(record.model, record.variant) for record in records}
    variants = Counter(model for model, _ in pairs)
    return [model for model in by_model(records) if variants[model] > 1]


def published(model: str, quantity: str) -> PaperFigure | None:
    """Return the paper's value of `quantity` for its `model`; None if the paper has none."""
    return _PAPER.results.get(model, {}).get(quantity)


def wilson(successes: int, runs: int) -> tuple[float, float]:
    """Return the 95 % score interval of a proportion, in closed form; (0, 1) if there are no runs.

    E. B. Wilson, "Probable Inference, the Law of Succession, and Statistical Inference", Journal
    of the American Statistical Association 22 (1927) 209-212. Raises ValueError if the counts are
    not a proportion.
    """
    if not 0 <= successes <= runs:
        raise ValueError(f"{successes} of {runs} is not a proportion")
    if runs == 0:
        return 0.0, 1.0
    share, square = successes / runs, Z95 * Z95
    centre = share + square / (2 * runs)
    spread = Z95 * math.sqrt(share * (1 - share) / runs + square / (4 * runs * runs))
    scale = 1 + square / runs
    low = 0.0 if successes == 0 else (centre - spread) / scale
    high = 1.0 if successes == runs else (centre + spread) / scale
    return min(low, share), max(high, share)


class SuccessRate(NamedTuple):
    """The number of successes among a number of runs."""

    successes: int
    runs: int

    @classmethod
    def of(cls, results: Iterable[bool | None]) -> "SuccessRate":
        """Return the rate of True among `results`; results of None do not count."""
        present = [result for result in results if result is not None]
        return cls(sum(present), len(present))

    @property
    def value(self) -> float | None:
        """The share of successes, 0 to 1; None if there are no runs."""
        return self.successes / self.runs if self.runs else None

    @property
    def low(self) -> float:
        """The lower end of the 95 % interval."""
        return wilson(self.successes, self.runs)[0]

    @property
    def high(self) -> float:
        """The upper end of the 95 % interval."""
        return wilson(self.successes, self.runs)[1]


def success_rate(records: Iterable[RunRecord], kind: SuccessKind = "strict") -> SuccessRate:
    """Return the rate of success among `records`; `kind` is the kind of success."""
    return SuccessRate.of(getattr(record, kind) for record in records)


class Confusion(NamedTuple):
    """The counts of a judgement against the truth; success is positive, failure is negative."""

    tp: int = 0
    fp: int = 0
    fn: int = 0
    tn: int = 0
    silent: int = 0
    """The runs without a judgement, which no rate includes."""

    @classmethod
    def of(cls, pairs: Iterable[tuple[Opinion | None, bool]]) -> "Confusion":
        """Return the counts of `pairs`, each of a judgement (None if missing) and the truth."""
        counts = Counter(pairs)
        return cls(
            tp=counts["Success", True],
            fp=counts["Success", False],
            fn=counts["Failure", True],
            tn=counts["Failure", False],
            silent=counts[None, True] + counts[None, False],
        )

    @property
    def judged(self) -> int:
        """The number of runs with a judgement."""
        return self.tp + self.fp + self.fn + self.tn

    @property
    def precision(self) -> SuccessRate:
        """The share of true successes among the runs judged a success."""
        return SuccessRate(self.tp, self.tp + self.fp)

    @property
    def recall(self) -> SuccessRate:
        """The share of runs judged a success among the true successes."""
        return SuccessRate(self.tp, self.tp + self.fn)

    @property
    def caught(self) -> SuccessRate:
        """The share of runs judged a failure among the true failures (specificity)."""
        return SuccessRate(self.tn, self.tn + self.fp)

    @property
    def base(self) -> SuccessRate:
        """The share of true successes among the judged runs, as a baseline for the precision.

        A judge that always finds a success has this precision.
        """
        return SuccessRate(self.tp + self.fn, self.judged)

    @property
    def f1(self) -> Interval | None:
        """F1 with a 95 % interval; None if no run was a success or was judged to be one.

        F1 = 2 J / (1 + J) increases with J = TP / (TP + FP + FN), which is a proportion (Hand,
        Christen, Kirielle, "F*: an interpretable transformation of the F-measure", Machine
        Learning 110, 2021). Therefore, Wilson's interval for J gives the interval for F1.
        """
        share = SuccessRate(self.tp, self.tp + self.fp + self.fn)
        if share.value is None:
            return None
        value, low, high = (2 * j / (1 + j) for j in (share.value, share.low, share.high))
        return value, low, high


class Spread(NamedTuple):
    """The mean of `n` values, half the width of its 95 % interval, median and 95th percentile."""

    n: int
    mean: float
    margin: float
    median: float
    p95: float


def spread(values: Sequence[float]) -> Spread | None:
    """Return the statistics of `values`; None if there are no values.

    The interval of the mean follows from the normal distribution; for a single value, its width is
    zero. The percentile is interpolated linearly between ranks.
    """
    if not values:
        return None
    margin = Z95 * stdev(values) / math.sqrt(len(values)) if len(values) > 1 else 0.0
    return Spread(
        len(values), fmean(values), margin, median(values), float(np.percentile(values, 95))
    )


class ReportTable(StrictModel):
    """A table of texts; `name` is unique in a report, and `note` explains the table."""

    name: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""

    @model_validator(mode="after")
    def _full_rows(self) -> "ReportTable":
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"{self.name}: {len(row)} cells under {len(self.columns)} titles")
        return self

    def numeric(self, column: int) -> bool:
        """Return whether every cell of `column` has a number, a rate or no value."""
        return column > 0 and all(_NUMBER.match(row[column]) for row in self.rows)


Cell = str | int | SuccessRate
"""The content of a cell; a rate is formatted by `rate_cell`."""


def table_of(
    kind: str,
    keys: Sequence[str],
    columns: Mapping[str, Callable[[Group], Cell]],
    groups: Mapping[tuple[str, ...], Group],
    **values: object,
) -> ReportTable:
    """Return the table `kind` with a row for each of `groups`.

    A row has the key of its group, then the result of each of `columns` for the group. `values` are
    inserted into the title and the note.
    """
    rows = [
        (*key, *(_written(column(group)) for column in columns.values()))
        for key, group in groups.items()
    ]
    return table_of_rows(kind, (*keys, *columns), rows, **values)


def table_of_rows(
    kind: str, columns: Sequence[str], rows: Sequence[tuple[str, ...]], **values: object
) -> ReportTable:
    """Return the table `kind` with `rows`; `values` are inserted into the title and the note.

    The value `of`, if given, is added to the table's name.
    """
    text = TEXTS.tables[kind]
    return ReportTable(
        name=f"{kind}-{values['of']}" if "of" in values else kind,
        title=text.title.format(**values),
        columns=tuple(columns),
        rows=tuple(rows),
        note=text.note.format(**values),
    )


def _written(cell: Cell) -> str:
    return rate_cell(cell) if isinstance(cell, SuccessRate) else str(cell)


def percent(share: float | None) -> str:
    """Return a share as a percentage."""
    return NOTHING if share is None else f"{100 * share:.0f}%"


def rate_cell(rate: SuccessRate) -> str:
    """Return a rate as `83% (71-91) 40/48`: value, 95 % Wilson interval, successes / runs."""
    if not rate.runs:
        return NOTHING
    interval = f"({100 * rate.low:.0f}–{100 * rate.high:.0f})"
    return f"{percent(rate.value)} {interval} {rate.successes}/{rate.runs}"


def fraction_cell(value: Interval | None) -> str:
    """Return a value between 0 and 1 with its interval as `0.83 (0.71-0.91)`."""
    return NOTHING if value is None else "{:.2f} ({:.2f}–{:.2f})".format(*value)


def seconds(value: float | None) -> str:
    """Return seconds as text; shorter times have more decimals, so that milliseconds show."""
    if value is None:
        return NOTHING
    digits = 3 if value < 0.1 else 2 if value < 10 else 1
    return f"{value:.{digits}f}"
