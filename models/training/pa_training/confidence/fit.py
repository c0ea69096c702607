"""Fits how sure the console says it is to orders of which it is known whether they were read right.

`python -m pa_training.confidence.fit ORDERS.jsonl` takes what `read_orders` wrote, prints
the coefficients for `session/confidence.py`, and how well they hold for orders that they were not
fitted to: the expected calibration error, and what would be told to be understood. Every order
whose reading the second reader told its mind on counts twice: as it was read, and as a console
without a second reader would have read it.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pa_console.session.confidence import (
    UNSURE,
    Coefficients,
    Evidence,
    calibrated_confidence,
    log_odds,
)
from pa_training.confidence.read_orders import ReadOrder

FOLDS, BINS = 10, 10
STEPS, RATE, RIDGE = 4000, 0.2, 1.0
"""Gradient descent, and how much large weights cost: as much as this times their square."""
_RISING = slice(3, 5)
"""The weights that must not be negative: of chances."""

Numbers = NDArray[np.float64]


class Known(NamedTuple):
    """How an order of a group was read, and whether that is right."""

    group: str
    evidence: Evidence
    right: bool
    main: bool = True
    """Whether it was read so; False of what a console without a second reader would tell."""


def known_orders(read: Sequence[ReadOrder]) -> list[Known]:
    """Return what is known of every order, with and without the second reader."""
    found = list[Known]()
    for order in read:
        told = [chance for chance in (order.planner, order.judge) if chance is not None]
        chance = min(told)
        without = Evidence(chance, order.own_gaps > 0)
        if not order.second:
            found.append(Known(order.group, without, order.own_right))
            continue
        second = "alone" if order.alone else "same" if order.second_same else "other"
        sure = order.second_sure or 0.0
        evidence = Evidence(chance, bool(order.gaps), second, sure)
        found += (
            Known(order.group, evidence, order.right),
            Known(order.group, without, order.own_right, main=False),
        )
    return found


def fit(known: Sequence[Known]) -> Coefficients:
    """Return the coefficients under which `known` is likeliest, monotone, by gradient descent."""
    fitted = [one for one in known if one.evidence.second != "other"]
    signs = np.array([_signs(one.evidence) for one in fitted])
    right = np.array([one.right for one in fitted], dtype=float)
    weights = np.zeros(signs.shape[1])
    for _ in range(STEPS):
        told = 1.0 / (1.0 + np.exp(-signs @ weights))
        slope = signs.T @ (told - right) / len(fitted) + RIDGE * weights / len(fitted)
        weights -= RATE * slope
        weights[_RISING] = np.maximum(weights[_RISING], 0.0)
    return Coefficients(*(round(float(weight), 3) for weight in weights))


def _signs(read: Evidence) -> list[float]:
    """Return what each coefficient is multiplied with, in their order."""
    kinds = [float(read.second == kind) for kind in ("", "same", "alone")]
    chance = log_odds(read.chance or 0.0) if not read.second else 0.0
    second = log_odds(read.second_chance) if read.second else 0.0
    return [*kinds, chance, second]


def cross_validated(known: Sequence[Known]) -> list[tuple[float, bool]]:
    """Return what is told of every order by what was fitted to the other groups alone."""
    groups = list(dict.fromkeys(one.group for one in known))
    found = list[tuple[float, bool]]()
    for fold in range(FOLDS):
        out = set(groups[fold::FOLDS])
        rest = [one for one in known if one.group not in out]
        if not rest:
            continue
        by = fit(rest)
        held = (one for one in known if one.group in out and one.main)
        found += ((calibrated_confidence(one.evidence, by) or 0.0, one.right) for one in held)
    return found


def calibration_error(told: Sequence[tuple[float, bool]]) -> float:
    """Return the expected calibration error over bins of a tenth."""
    bins: dict[int, list[tuple[float, bool]]] = {}
    for sure, right in told:
        bins.setdefault(min(int(sure * BINS), BINS - 1), []).append((sure, right))
    apart = (abs(sum(s for s, _ in each) - sum(r for _, r in each)) for each in bins.values())
    return sum(apart) / len(told)


def told_of(told: Sequence[tuple[float, bool]]) -> str:
    """Return calibration error, and the orders told to be understood, in words."""
    sure = [right for chance, right in told if chance >= UNSURE]
    return (
        f"{len(told)} orders, {sum(r for _, r in told)} right; calibration error "
        f"{calibration_error(told):.3f}; {len(sure)} at least {UNSURE:.0%} sure, "
        f"{sum(sure)} of them right"
    )


def main() -> None:
    """Print coefficients, and how well they hold."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("orders", type=Path, nargs="+", help="files that read_orders has written")
    lines = [line for path in parser.parse_args().orders for line in path.open(encoding="utf-8")]
    known = known_orders([ReadOrder.model_validate_json(line) for line in lines])
    print(fit(known))
    print(f"cross-validated: {told_of(cross_validated(known))}")


if __name__ == "__main__":
    main()
