"""Fits the chances of readings to orders of which it is known what they ask for.

`python -m pa_training.confidence.fit ORDERS.jsonl` takes what `read_orders` wrote, prints the
coefficients for `session/confidence.py`, and how well they hold for orders that they were not
fitted to: the readings that would be preferred, the expected calibration error, and what would be
told to be understood. Every order that the second reader has read counts twice: as it was read, and
as a console without a second reader would have read it.
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
    chances,
    features,
)
from pa_training.confidence.read_orders import ReadOrder

FOLDS, BINS = 10, 10
STEPS, RATE, RIDGE = 4000, 0.2, 1.0
"""Gradient descent, and how much large weights cost: as much as this times their square."""
_RISING = [Coefficients._fields.index(name) for name in Coefficients._fields if "odds" in name]
"""The weights that must not be negative: of chances."""
_FALLING = Coefficients._fields.index("gaps")
"""The weight that must not be positive: of what speaks against a reading."""

Numbers = NDArray[np.float64]


class Known(NamedTuple):
    """The readings of one order of a group, and which of them are right."""

    group: str
    readings: tuple[Evidence, ...]
    right: tuple[bool, ...]
    main: bool = True
    """Whether it was read so; False of what a console without a second reader would know."""


def known_orders(read: Sequence[ReadOrder]) -> list[Known]:
    """Return what is known of every order, with and without the second reader."""
    found = list[Known]()
    for order in read:
        if not order.readings:
            continue
        evidence = tuple(each.evidence for each in order.readings)
        right = tuple(each.right for each in order.readings)
        found.append(Known(order.group, evidence, right))
        if any(each.second is not None for each in evidence):
            own = [
                (each._replace(second=None), so)
                for each, so in zip(evidence, right, strict=True)
                if each.planner is not None or each.judge is not None
            ]
            found.append(
                Known(order.group, tuple(e for e, _ in own), tuple(so for _, so in own), main=False)
            )
    return found


def fit(known: Sequence[Known]) -> Coefficients:
    """Return the coefficients under which `known` is likeliest, monotone, by gradient descent."""
    width = max(len(one.readings) for one in known)
    signs = np.zeros((len(known), width, len(Coefficients._fields)))
    there, right = np.zeros((len(known), width)), np.zeros((len(known), width))
    for row, one in enumerate(known):
        count = len(one.readings)
        signs[row, :count], right[row, :count] = features(one.readings), one.right
        there[row, :count] = 1.0
    weights = np.zeros(signs.shape[2])
    for _ in range(STEPS):
        likely = _shares(signs, there, weights)
        wanted = _shares(signs, right, weights, none=0.0)
        slope = np.einsum("rc,rcf->f", likely - wanted, signs) + RIDGE * weights
        weights -= RATE * slope / len(known)
        weights[_RISING] = np.maximum(weights[_RISING], 0.0)
        weights[_FALLING] = np.minimum(weights[_FALLING], 0.0)
    return Coefficients(*(round(float(weight), 3) for weight in weights))


def _shares(signs: Numbers, there: Numbers, weights: Numbers, none: float = 1.0) -> Numbers:
    """Return the share of each reading that is `there`; `none` is the weight of no reading."""
    each = there * np.exp(signs @ weights)
    return each / np.maximum(none + each.sum(axis=1, keepdims=True), 1e-12)


def cross_validated(known: Sequence[Known]) -> list[tuple[float, bool]]:
    """Return the likeliest reading's chance by what was fitted to other groups alone."""
    groups = list(dict.fromkeys(one.group for one in known))
    found = list[tuple[float, bool]]()
    for fold in range(FOLDS):
        out = set(groups[fold::FOLDS])
        rest = [one for one in known if one.group not in out]
        if not rest:
            continue
        by = fit(rest)
        for one in known:
            if one.group in out and one.main:
                found.append(max(zip(chances(one.readings, by), one.right, strict=True)))
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


def as_put(read: Sequence[ReadOrder]) -> str:
    """Return how often the console's own choice was right, in words."""
    plain = [order.right for order in read if order.state == "approve"]
    told = [(order.confidence, order.right) for order in read if order.confidence is not None]
    return (
        f"{len(read)} orders, {sum(order.right for order in read)} right; {len(plain)} told to "
        f"approve, {sum(plain)} of them right; calibration error {calibration_error(told):.3f}"
    )


def main() -> None:
    """Print coefficients, and how well they hold."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("orders", type=Path, nargs="+", help="files that read_orders has written")
    parser.add_argument("--as-put", action="store_true", help="fit nothing; print what was put")
    given = parser.parse_args()
    lines = [line for path in given.orders for line in path.open(encoding="utf-8")]
    read = [ReadOrder.model_validate_json(line) for line in lines]
    print(f"as put to the operator: {as_put(read)}")
    if given.as_put:
        return
    known = known_orders(read)
    print(fit(known))
    print(f"cross-validated: {told_of(cross_validated(known))}")


if __name__ == "__main__":
    main()
