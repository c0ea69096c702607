"""What the operator is told of how sure the console is: monotone, and never sure of what is not."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.session.confidence import (
    UNSURE,
    Evidence,
    WeighedReading,
    calibrated_confidence,
    chances,
    read_apart,
    weighed,
)

CHANCES = st.floats(0.0, 1.0)
TOLD = st.none() | CHANCES
READINGS = st.builds(Evidence, TOLD, TOLD, TOLD, st.integers(0, 4))
READERS = st.sampled_from(("planner", "judge", "second"))


def told(
    *,
    planner: float | None = None,
    judge: float | None = None,
    second: float | None = None,
    gaps: int = 0,
) -> float:
    found = calibrated_confidence(Evidence(planner, judge, second, gaps=gaps))
    assert found is not None
    return found


@given(READINGS, st.lists(READINGS, max_size=2), READERS, CHANCES, CHANCES)
def test_a_greater_chance_never_makes_it_less(
    read: Evidence, others: list[Evidence], reader: str, one: float, other: float
) -> None:
    low, high = sorted((one, other))
    less, *rivals = chances([read._replace(**{reader: low}), *others])
    more, *beaten = chances([read._replace(**{reader: high}), *others])
    assert 0.0 <= less <= more <= 1.0
    assert all(after <= before for before, after in zip(rivals, beaten, strict=True))


@given(READINGS, st.lists(READINGS, max_size=2))
def test_a_gap_never_makes_it_more(read: Evidence, others: list[Evidence]) -> None:
    without = chances([read._replace(gaps=0), *others])[0]
    assert chances([read._replace(gaps=1), *others])[0] <= without


@given(st.lists(READINGS, min_size=1, max_size=3))
def test_the_chances_of_all_readings_are_those_of_one_order(readings: list[Evidence]) -> None:
    assert sum(chances(readings)) <= 1.0 + 1e-3


@given(CHANCES, CHANCES)
def test_what_nobody_bears_out_never_passes_for_understood(chance: float, sure: float) -> None:
    assert told(planner=chance, judge=chance, gaps=1) < UNSURE
    assert told(second=sure) < UNSURE


@given(st.floats(0.5, 1.0), st.floats(0.0, 0.9))
def test_a_sure_second_reader_that_says_something_else_leaves_a_doubt(
    sure: float, own: float
) -> None:
    found = weighed(
        [
            WeighedReading("asked: hold", "planner", Evidence(own, own)),
            WeighedReading("asked: report", "second", Evidence(second=sure)),
        ]
    )
    first = next(each for each in found if each.reader == "planner")
    assert first.chance < UNSURE or read_apart(first, found)


@given(CHANCES, CHANCES)
def test_what_one_reader_alone_has_read_is_in_doubt(one: float, other: float) -> None:
    found = weighed(
        [
            WeighedReading("asked: hold", "planner", Evidence(one)),
            WeighedReading("asked: report", "judge", Evidence(judge=other)),
        ]
    )
    assert all(read_apart(each, found) for each in found)


def test_a_reading_whose_accuracy_nobody_measured_leaves_a_doubt() -> None:
    found = weighed(
        [
            WeighedReading("asked: hold", "planner", Evidence(0.99, 0.99)),
            WeighedReading("asked: report", "second", Evidence()),
        ]
    )
    assert read_apart(found[0], found)


def test_a_reading_of_two_is_not_in_doubt_for_an_unlikely_third() -> None:
    found = weighed(
        [
            WeighedReading("asked: hold", "planner", Evidence(0.85, 0.8)),
            WeighedReading("asked: report", "second", Evidence(second=0.35, gaps=2)),
        ]
    )
    assert found[0].asked == "asked: hold"
    assert not read_apart(found[0], found)


def test_an_unsure_reading_that_another_shares_is_understood() -> None:
    alone = told(planner=0.4, judge=0.4)
    assert alone < UNSURE <= told(planner=0.4, judge=0.4, second=0.99)


@pytest.mark.parametrize("gaps", [0, 1])
def test_nothing_is_told_where_nobody_tells(gaps: int) -> None:
    assert calibrated_confidence(Evidence(gaps=gaps)) is None
