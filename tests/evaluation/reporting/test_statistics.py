"""Rates, judgements and spreads mean what their names say."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.evaluation.reporting.statistics import Confusion, SuccessRate, spread, wilson
from pa_console.evaluation.run_record import Opinion

COUNTS = st.integers(0, 400).flatmap(lambda runs: st.tuples(st.integers(0, runs), st.just(runs)))


@pytest.mark.parametrize(
    ("successes", "runs", "low", "high"),
    [
        (0, 10, 0.0, 0.2775),
        (10, 10, 0.7225, 1.0),
        (5, 10, 0.2366, 0.7634),
        (81, 263, 0.2553, 0.3662),
    ],
)
def test_intervals_are_those_of_the_literature(
    successes: int, runs: int, low: float, high: float
) -> None:
    assert wilson(successes, runs) == pytest.approx((low, high), abs=1e-4)


@given(COUNTS)
def test_an_interval_contains_its_rate_and_is_a_share(counts: tuple[int, int]) -> None:
    rate = SuccessRate(*counts)
    assert 0.0 <= rate.low <= rate.high <= 1.0
    if rate.value is not None:
        assert rate.low <= rate.value <= rate.high


@given(COUNTS)
def test_more_runs_with_the_same_share_tell_more(counts: tuple[int, int]) -> None:
    successes, runs = counts
    if runs:
        few, many = SuccessRate(successes, runs), SuccessRate(10 * successes, 10 * runs)
        assert many.high - many.low < few.high - few.low


def test_no_runs_have_no_rate_and_tell_nothing() -> None:
    assert SuccessRate.of([]).value is None
    assert wilson(0, 0) == (0.0, 1.0)


def test_counts_that_are_no_proportion_are_refused() -> None:
    with pytest.raises(ValueError, match="3 of 2"):
        wilson(3, 2)


Judged = tuple[Opinion | None, bool]
OPINIONS: tuple[Opinion | None, ...] = ("Success", "Failure", None)
PAIRS = st.lists(st.tuples(st.sampled_from(OPINIONS), st.booleans()))


@given(PAIRS)
def test_every_run_is_in_one_cell_of_the_matrix(pairs: list[Judged]) -> None:
    found = Confusion.of(pairs)
    assert found.judged + found.silent == len(pairs)
    assert found.silent == sum(said is None for said, _ in pairs)
    assert found.recall.runs + found.caught.runs == found.judged


@given(PAIRS)
def test_f1_is_the_harmonic_mean_within_its_interval(pairs: list[Judged]) -> None:
    found = Confusion.of(pairs)
    if found.f1 is None:
        assert found.tp + found.fp + found.fn == 0
        return
    value, low, high = found.f1
    assert 0.0 <= low <= value <= high <= 1.0
    precision, recall = found.precision.value, found.recall.value
    if precision and recall:
        assert value == pytest.approx(2 * precision * recall / (precision + recall))


def test_a_judge_that_always_agrees_is_as_precise_as_runs_succeed() -> None:
    truths = (True, True, True, False)
    always: list[Judged] = [("Success", truth) for truth in truths]
    found = Confusion.of(always)
    assert found.precision == found.base == SuccessRate(3, 4)
    assert found.caught == SuccessRate(0, 1)


@given(st.lists(st.floats(0, 1e6), min_size=1))
def test_a_spread_lies_within_its_values(values: list[float]) -> None:
    found = spread(values)
    assert found is not None
    assert found.n == len(values)
    slack = 1e-9 * max(values)
    for middle in (found.mean, found.median, found.p95):
        assert min(values) - slack <= middle <= max(values) + slack
    assert found.median <= found.p95 + slack
    assert math.isfinite(found.margin)


def test_nothing_has_no_spread() -> None:
    assert spread([]) is None
    assert spread([2.0]) == (1, 2.0, 0.0, 2.0, 2.0)
