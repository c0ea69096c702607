"""The confidence that an order was read correctly, calibrated on orders with known readings.

A model's own chance means little by itself: a reading with a chance of 40 % is nearly always right
if a second reader agrees, and far less often if it disagrees. The confidence is therefore a
logistic function of the evidence for a reading. A greater chance never lowers it.

The function is fitted to 283 orders of the seeds 434 and 436, some from templates and some in
people's own words, which neither model has seen in training. Cross-validated by situation, its
expected calibration error is 0.05. The second reader's adapter has been trained further since the
fit (`models/pa-500m.md`). To fit it again:

    python -m pa_training.confidence.read_orders --out ORDERS.jsonl
    python -m pa_training.confidence.fit ORDERS.jsonl

The confidence alone decides nothing: after a gap or between readers that disagree, a plan cannot
be approved without a warning at any confidence (`mission/approval.py`).
"""

import math
from typing import Literal, NamedTuple

SecondAnswer = Literal["", "same", "other", "alone"]
"""The second reader's answer: none, the reading of the plan, or another; or the plan is for a
reading of the second reader alone."""

UNSURE = 0.8
"""The confidence below which an order may be misunderstood."""

MOST_DOUBTED = 0.75
"""The most confidence in a reading with a gap that no second reader confirms (28 of 39 such orders
were read correctly), and in a reading of the second reader alone: it was trained on phrasings like
those of the fitted orders, so it is right more often there than elsewhere."""

LEAST_CHANCE, MOST_CHANCE = 0.01, 0.99
"""Bounds of a chance: the last per mille of a model's chance have no meaning."""


class Coefficients(NamedTuple):
    """Weights of the evidence for a reading, in log odds."""

    unasked: float
    """The constant for a reading without a second reader's answer."""
    same: float
    """The constant for a reading that the second reader shares."""
    alone: float
    """The constant for a reading of the second reader alone."""
    chance: float
    """The factor of the lower chance of planner and judge; without a second reader only."""
    second_chance: float
    """The factor of the second reader's chance; for a reading of its own only."""


FITTED = Coefficients(unasked=0.981, same=0.604, alone=0.654, chance=0.675, second_chance=0.511)


class Evidence(NamedTuple):
    """The evidence for the reading of an order."""

    chance: float | None
    """The lower chance of planner and judge; None if neither reports one."""
    gaps: bool = False
    second: SecondAnswer = ""
    second_chance: float = 0.0


def calibrated_confidence(read: Evidence, by: Coefficients = FITTED) -> float | None:
    """Return the share of orders `read` like this one that are right; None without a chance."""
    chance = read.chance or 0.0
    match read.second:
        case "other":
            return round(min(chance, 1.0 - read.second_chance), 4)
        case "alone":
            odds = by.alone + by.second_chance * log_odds(read.second_chance)
        case "same":
            odds = by.same + by.second_chance * log_odds(read.second_chance)
        case "":
            if read.chance is None:
                return None
            odds = by.unasked + by.chance * log_odds(chance)
    confidence = round(1.0 / (1.0 + math.exp(-odds)), 4)
    doubted = read.second == "alone" or (read.gaps and not read.second)
    return min(confidence, MOST_DOUBTED) if doubted else confidence


def log_odds(chance: float) -> float:
    """Return the logarithm of the odds of a `chance`, which is bounded away from certainty."""
    kept = min(max(chance, LEAST_CHANCE), MOST_CHANCE)
    return math.log(kept / (1.0 - kept))
