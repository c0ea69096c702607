"""What the console says of its readings is fitted to orders whose right reading is known."""

import random

from pa_console.session.confidence import Evidence, chances
from pa_training.confidence.fit import (
    Known,
    calibration_error,
    cross_validated,
    fit,
    known_orders,
)
from pa_training.confidence.read_orders import KnownReading, ReadOrder


def drawn(count: int) -> list[Known]:
    """Return orders that are right as often as the chance of their reading says."""
    rng = random.Random(7)
    told = [rng.uniform(0.2, 0.95) for _ in range(count)]
    return [
        Known(str(n % 20), (Evidence(chance, chance),), (rng.random() < chance,))
        for n, chance in enumerate(told)
    ]


def test_chances_that_are_right_are_told_as_they_are() -> None:
    by = fit(drawn(2000))
    for chance in (0.3, 0.6, 0.9):
        assert abs(chances([Evidence(chance, chance)], by)[0] - chance) < 0.07


def test_orders_that_were_left_out_are_told_rightly() -> None:
    assert calibration_error(cross_validated(drawn(2000))) < 0.06


def test_the_calibration_error_is_the_distance_between_what_is_told_and_what_is_right() -> None:
    assert calibration_error([(0.75, True), (0.75, False)]) == 0.25


def test_a_chance_that_says_the_opposite_counts_for_nothing() -> None:
    orders = [Known("", (Evidence(chance),), (chance < 0.5,)) for chance in (0.1, 0.2, 0.8, 0.9)]
    assert fit(orders).odds == 0.0


def test_of_two_readings_the_one_that_is_right_more_often_is_preferred() -> None:
    first, second = Evidence(0.5), Evidence(second=0.5)
    orders = [
        Known("", (first, second), (number % 4 == 0, number % 4 != 0)) for number in range(40)
    ]
    own, other = chances([first, second], fit(orders))
    assert own + 0.2 < other


def test_an_order_that_was_read_again_counts_with_the_second_reader_and_without() -> None:
    own, other = Evidence(0.4, 0.3, gaps=1), Evidence(second=0.9)
    read = ReadOrder(
        group="1-0",
        kind="go",
        text="",
        meant="asked: hold",
        readings=(
            KnownReading(asked="asked: hold", evidence=other, chance=0.7, right=True),
            KnownReading(asked="asked: report", evidence=own, chance=0.2, right=False),
        ),
        served="asked: hold",
        right=True,
        state="approve",
        confidence=0.7,
    )
    assert known_orders([read]) == [
        Known("1-0", (other, own), (True, False)),
        Known("1-0", (own,), (False,), main=False),
    ]
