"""What the console says of its readings is fitted to orders whose right reading is known."""

import random

from pa_console.session.confidence import Evidence, calibrated_confidence
from pa_training.confidence.fit import (
    Known,
    calibration_error,
    cross_validated,
    fit,
    known_orders,
)
from pa_training.confidence.read_orders import ReadOrder


def drawn(count: int) -> list[Known]:
    """Return orders that are right as often as the chance of their reading says."""
    rng = random.Random(7)
    chances = [rng.uniform(0.2, 0.95) for _ in range(count)]
    return [
        Known(str(n % 20), Evidence(chance), rng.random() < chance)
        for n, chance in enumerate(chances)
    ]


def test_chances_that_are_right_are_told_as_they_are() -> None:
    by = fit(drawn(2000))
    for chance in (0.3, 0.6, 0.9):
        told = calibrated_confidence(Evidence(chance), by)
        assert told is not None
        assert abs(told - chance) < 0.07


def test_orders_that_were_left_out_are_told_rightly() -> None:
    assert calibration_error(cross_validated(drawn(2000))) < 0.06


def test_the_calibration_error_is_the_distance_between_what_is_told_and_what_is_right() -> None:
    assert calibration_error([(0.75, True), (0.75, False)]) == 0.25


def test_a_chance_that_says_the_opposite_counts_for_nothing() -> None:
    by = fit([Known("", Evidence(chance), chance < 0.5) for chance in (0.1, 0.2, 0.8, 0.9)])
    assert by.chance == 0.0


def test_an_order_that_was_read_again_counts_with_the_second_reader_and_without() -> None:
    read = ReadOrder(
        group="1-0", kind="go", text="", meant="", asked="", planner=0.4, judge=0.3,
        judge_fits=True, gaps=(), own_gaps=1, second="asked: hold", second_sure=0.9,
        second_same=True, alone=False, right=True, own_right=False,
    )  # fmt: skip
    assert known_orders([read]) == [
        Known("1-0", Evidence(0.3, gaps=False, second="same", second_chance=0.9), right=True),
        Known("1-0", Evidence(0.3, gaps=True), right=False, main=False),
    ]
