"""Measures two ways of doing the same in turn, and says how many times better ours is.

Runs alternate, ours, the other, ours, the other, so that a machine that slows down or speeds up
slows or speeds both; what is compared are the medians.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from statistics import median
from timeit import Timer
from typing import Literal

import numpy as np

from pa_console.evaluation.run_record import Machine
from pa_console.llm.models.catalogue import LocalModel
from pa_console.schema.base import StrictModel
from pa_console.station.assembly import Site
from tests.benchmarks.harness import Tell

Unit = Literal["s", "tokens/s", "MB"]
Operation = Callable[[], object]

SAMPLE_S = 0.02
"""A quick operation is repeated within one run until the run takes about so long."""


class Way(StrictModel):
    """One way of doing it: what it is and its figures over the runs, in the comparison's unit."""

    what: str
    median: float
    least: float
    most: float
    p95: float


class Comparison(StrictModel):
    """One line of the benchmark; `other` is None for what is a cost and nothing else.

    `ratio` is how many times better ours is: the other's seconds or megabytes over ours, or our
    tokens a second over the other's. Against a limit, what is below 1 is the share that we reach.
    """

    part: str
    name: str
    unit: Unit
    runs: int
    ours: Way
    other: Way | None
    ratio: float | None
    note: str = ""


class BenchReport(StrictModel):
    """The figures of all parts; `model` is empty when no part needed one."""

    machine: Machine
    model: str
    model_sha256: str
    runs: int
    comparisons: tuple[Comparison, ...]


@dataclass(frozen=True)
class Bench:
    """What every part is given; `tell` hears what is measured and the share of the part done."""

    site: Site
    model: LocalModel | None
    runs: int
    tell: Tell

    @property
    def weights(self) -> LocalModel:
        """The model; raises ValueError when none was given, which a part that needs one forbids."""
        if self.model is None:
            raise ValueError("this part of the benchmark needs a model")
        return self.model


def compare(
    part: str,
    name: str,
    ours: tuple[str, Sequence[float]],
    other: tuple[str, Sequence[float]] | None = None,
    unit: Unit = "s",
    note: str = "",
) -> Comparison:
    """Return the comparison of two ways, each a description and its figures of every run.

    Raises ValueError when one has no figures.
    """
    mine, theirs = _way(*ours), None if other is None else _way(*other)
    ratio = None
    if theirs is not None and mine.median > 0.0 and theirs.median > 0.0:
        better = mine.median / theirs.median
        ratio = better if unit == "tokens/s" else 1.0 / better
    return Comparison(
        part=part,
        name=name,
        unit=unit,
        runs=len(ours[1]),
        ours=mine,
        other=theirs,
        ratio=ratio,
        note=note,
    )


def alternate(runs: int, operations: Iterable[Operation]) -> list[list[float]]:
    """Return, for each of `operations`, the seconds of one call in every run, taken in turn."""
    timers = [Timer(operation) for operation in operations]
    loops = [_loops(timer) for timer in timers]
    seconds: list[list[float]] = [[] for _ in timers]
    for _ in range(runs):
        for timer, number, taken in zip(timers, loops, seconds, strict=True):
            taken.append(timer.timeit(number) / number)
    return seconds


def _loops(timer: Timer) -> int:
    """Return how many calls take about SAMPLE_S; the first call, which warms up, is not counted."""
    timer.timeit(1)
    return max(1, round(SAMPLE_S / max(timer.timeit(1), 1e-7)))


def _way(what: str, figures: Sequence[float]) -> Way:
    if not figures:
        raise ValueError(f"{what}: nothing was measured")
    return Way(
        what=what,
        median=median(figures),
        least=min(figures),
        most=max(figures),
        p95=float(np.percentile(figures, 95)),
    )
