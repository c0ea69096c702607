"""What the operator is told of how sure the console is: monotone, and never sure of what is not."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.session.confidence import UNSURE, Evidence, SecondAnswer, calibrated_confidence

CHANCES = st.floats(0.0, 1.0)
SECONDS = st.sampled_from(("", "same", "other", "alone"))


def told(*, chance: float | None, gaps: bool = False, second: SecondAnswer = "", sure: float = 0.0):
    found = calibrated_confidence(Evidence(chance, gaps, second, sure))
    assert found is not None
    return found


@given(CHANCES, CHANCES, st.booleans(), SECONDS, CHANCES)
def test_a_greater_chance_never_makes_it_less(
    one: float, other: float, gaps: bool, second: SecondAnswer, sure: float
) -> None:
    low, high = sorted((one, other))
    less = told(chance=low, gaps=gaps, second=second, sure=sure)
    assert 0.0 <= less <= told(chance=high, gaps=gaps, second=second, sure=sure) <= 1.0


@given(CHANCES, SECONDS, CHANCES)
def test_a_gap_never_makes_it_more(chance: float, second: SecondAnswer, sure: float) -> None:
    without = told(chance=chance, second=second, sure=sure)
    assert told(chance=chance, gaps=True, second=second, sure=sure) <= without


@given(CHANCES, CHANCES)
def test_what_nobody_bears_out_never_passes_for_understood(chance: float, sure: float) -> None:
    assert told(chance=chance, gaps=True) < UNSURE
    assert told(chance=None, second="alone", sure=sure) < UNSURE


@given(st.floats(0.5, 1.0))
def test_a_second_reader_that_says_something_else_leaves_a_doubt(sure: float) -> None:
    assert told(chance=1.0, second="other", sure=sure) < UNSURE


def test_an_unsure_reading_that_another_shares_is_understood() -> None:
    assert told(chance=0.4) < UNSURE <= told(chance=0.4, second="same", sure=0.99)


@pytest.mark.parametrize("gaps", [False, True])
def test_nothing_is_told_where_nobody_tells(gaps: bool) -> None:
    assert calibrated_confidence(Evidence(None, gaps)) is None
