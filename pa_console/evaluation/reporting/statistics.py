"""Rates with Wilson intervals, judgements against the truth, percentiles, and tables of them."""

import math
import re
from collections.abc import Iterable, Sequence
from statistics import fmean, median, stdev
from typing import NamedTuple

import numpy as np
from pydantic import model_validator

from pa_console.evaluation.runs.run_record import Opinion
from pa_console.schema.base import StrictModel

Z95 = 1.959963984540054
"""The normal quantile of a two-sided interval of 95 %."""


def wilson(successes: int, runs: int) -> tuple[float, float]:
    """Return the 95 % score interval of a proportion, in closed form; (0, 1) without any run.

    E. B. Wilson, "Probable Inference, the Law of Succession, and Statistical Inference", Journal
    of the American Statistical Association 22 (1927) 209-212. Raises ValueError for counts that
    are no proportion.
    """
    if not 0 <= successes <= runs:
        raise ValueError(f"{successes} of {runs} is no proportion")
    if runs == 0:
        return 0.0, 1.0
    share, square = successes / runs, Z95 * Z95
    centre = share + square / (2 * runs)
    spread = Z95 * math.sqrt(share * (1 - share) / runs + square / (4 * runs * runs))
    scale = 1 + square / runs
    low = 0.0 if successes == 0 else (centre - spread) / scale
    high = 1.0 if successes == runs else (centre + spread) / scale
    return min(low, share), max(high, share)


class Rate(NamedTuple):
    """The number of successes among a number of runs."""

    successes: int
    runs: int

    @classmethod
    def of(cls, results: Iterable[bool | None]) -> "Rate":
        """Count the true values among `results`; None is no result and does not count."""
        found = [result for result in results if result is not None]
        return cls(sum(found), len(found))

    @property
    def value(self) -> float | None:
        """The share of successes, 0 to 1; None without any run."""
        return self.successes / self.runs if self.runs else None

    @property
    def low(self) -> float:
        """The lower end of the 95 % interval."""
        return wilson(self.successes, self.runs)[0]

    @property
    def high(self) -> float:
        """The upper end of the 95 % interval."""
        return wilson(self.successes, self.runs)[1]


class Confusion(NamedTuple):
    """The counts of a judgement against the truth: success (positive) or failure (negative)."""

    tp: int = 0
    fp: int = 0
    fn: int = 0
    tn: int = 0
    silent: int = 0
    """Runs on which there was no judgement; they count in no rate."""

    @classmethod
    def of(cls, pairs: Iterable[tuple[Opinion | None, bool]]) -> "Confusion":
        """Count pairs of a judgement (None: there was none) and the truth."""
        counts = {
            (said, true): 0 for said in ("Success", "Failure", None) for true in (True, False)
        }
        for said, true in pairs:
            counts[said, true] += 1
        return cls(
            tp=counts["Success", True],
            fp=counts["Success", False],
            fn=counts["Failure", True],
            tn=counts["Failure", False],
            silent=counts[None, True] + counts[None, False],
        )

    @property
    def judged(self) -> int:
        """Runs with a judgement."""
        return self.tp + self.fp + self.fn + self.tn

    @property
    def flipped(self) -> "Confusion":
        """The same with failure as the positive: how well failures are caught."""
        return Confusion(tp=self.tn, fp=self.fn, fn=self.fp, tn=self.tp, silent=self.silent)

    @property
    def precision(self) -> Rate:
        """The share of true successes among the runs judged a success."""
        return Rate(self.tp, self.tp + self.fp)

    @property
    def recall(self) -> Rate:
        """The share of runs judged a success among the true successes."""
        return Rate(self.tp, self.tp + self.fn)

    @property
    def caught(self) -> Rate:
        """The share of runs judged a failure among the true failures (specificity)."""
        return Rate(self.tn, self.tn + self.fp)

    @property
    def base(self) -> Rate:
        """The share of true successes among the judged runs: the precision of always judging so."""
        return Rate(self.tp + self.fn, self.judged)

    @property
    def f1(self) -> tuple[float, float, float] | None:
        """F1 with a 95 % interval, None when nothing was, or was judged, a success.

        F1 = 2 J / (1 + J) grows with J = TP / (TP + FP + FN), which is a proportion (Hand,
        Christen, Kirielle, "F*: an interpretable transformation of the F-measure", Machine
        Learning 110, 2021): so the ends of Wilson's interval for J give those for F1.
        """
        share = Rate(self.tp, self.tp + self.fp + self.fn)
        if share.value is None:
            return None
        value, low, high = (2 * j / (1 + j) for j in (share.value, share.low, share.high))
        return value, low, high


class Spread(NamedTuple):
    """Mean with the half-width of its 95 % interval, median and 95th percentile of `n` values."""

    n: int
    mean: float
    margin: float
    median: float
    p95: float


def spread(values: Sequence[float]) -> Spread | None:
    """Summarise `values`, None when there are none.

    The interval of the mean is the normal one (zero for one value); the percentile is
    interpolated linearly between ranks.
    """
    if not values:
        return None
    margin = Z95 * stdev(values) / math.sqrt(len(values)) if len(values) > 1 else 0.0
    return Spread(
        len(values), fmean(values), margin, median(values), float(np.percentile(values, 95))
    )


NOTHING = "-"
"""The cell of a value that there is not."""

_NUMBER = re.compile(r"[+-]?\d[\d.,]*[%*/]{0,2}( |\d|$)|-$")


class Table(StrictModel):
    """Rows of text under column titles; `name` is unique in a report, `note` explains it."""

    name: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""

    @model_validator(mode="after")
    def _full_rows(self) -> "Table":
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"{self.name}: {len(row)} cells under {len(self.columns)} titles")
        return self

    def numeric(self, column: int) -> bool:
        """Return whether every cell of `column` is a number, a rate or nothing."""
        return column > 0 and all(_NUMBER.match(row[column]) for row in self.rows)


def percent(share: float | None) -> str:
    """Write a share as a percentage."""
    return NOTHING if share is None else f"{100 * share:.0f}%"


def rate_cell(rate: Rate) -> str:
    """Write a rate as `83% (71-91) 40/48`: value, 95 % Wilson interval, successes and runs."""
    if not rate.runs:
        return NOTHING
    interval = f"({100 * rate.low:.0f}–{100 * rate.high:.0f})"
    return f"{percent(rate.value)} {interval} {rate.successes}/{rate.runs}"


def fraction_cell(value: tuple[float, float, float] | None) -> str:
    """Write a value between 0 and 1 and its interval as `0.83 (0.71-0.91)`."""
    return NOTHING if value is None else "{:.2f} ({:.2f}–{:.2f})".format(*value)


def seconds(value: float | None) -> str:
    """Write seconds with about three digits, so that milliseconds stay distinct."""
    if value is None:
        return NOTHING
    digits = 3 if value < 0.1 else 2 if value < 10 else 1
    return f"{value:.{digits}f}"
