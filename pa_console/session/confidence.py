"""How sure the operator is told that the console is of an order: how often one read so is right.

A model's own chance says little by itself: where a second reader says the same, an order of which
the planner gave its reading 40 % is nearly always right; where it says something else, far less
often. So what is told is a logistic function of what is known of the reading, fitted to orders of
which the right reading is known. A greater chance never makes it less.

Fitted to 283 orders of the seeds 434 and 436, in words of the templates and as people say them, of
which neither model has learnt those of people. Cross-validated by situation, the expected
calibration error is 0.05. To fit it again:

    python -m pa_training.confidence.read_orders --out ORDERS.jsonl
    python -m pa_training.confidence.fit ORDERS.jsonl

What is told decides nothing alone: a gap, or readers who differ, keep a plan from being plainly
approved however sure it is told to be (`orchestrator/planning/approval.py`).
"""

import math
from typing import Literal, NamedTuple

Second = Literal["", "same", "other", "alone"]
"""What the second reader says: nothing, what the plan is for, something else; or the plan is for
what it alone has read."""

UNSURE = 0.8
"""Told to be less sure than this, an order may be misunderstood."""

MOST_DOUBTED = 0.75
"""At most this is told where words of the order and its reading do not match and no second reader
bears it out (28 of 39 such orders were read as meant), and of what the second reader alone has
read. The orders that are fitted to are said in ways that it has learnt: it is right more often
there than elsewhere."""

LEAST_CHANCE, MOST_CHANCE = 0.01, 0.99
"""Chances beyond these are taken for these: a model's last per mille say nothing."""


class Coefficients(NamedTuple):
    """Weights of what is known of a reading, in log odds."""

    unasked: float
    """Without a second reader's answer."""
    same: float
    """Where the second reader says the same."""
    alone: float
    """Where the plan is for what the second reader alone has read."""
    chance: float
    """By the log odds of the chance that planner and judge gave, the lower one; unasked only."""
    second_chance: float
    """By the log odds of the second reader's chance; where the plan is for what it says."""


FITTED = Coefficients(unasked=0.981, same=0.604, alone=0.654, chance=0.675, second_chance=0.511)


class Evidence(NamedTuple):
    """What is known of how an order was read."""

    chance: float | None
    """Of planner and judge, the lower one; None where neither tells."""
    gaps: bool = False
    second: Second = ""
    second_chance: float = 0.0


def told_confidence(read: Evidence, by: Coefficients = FITTED) -> float | None:
    """Return how often an order that was `read` so is right, 0 to 1; None where nobody tells."""
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
    told = round(1.0 / (1.0 + math.exp(-odds)), 4)
    doubted = read.second == "alone" or (read.gaps and not read.second)
    return min(told, MOST_DOUBTED) if doubted else told


def log_odds(chance: float) -> float:
    """Return the logarithm of the odds of a `chance`, which is kept from certainty."""
    kept = min(max(chance, LEAST_CHANCE), MOST_CHANCE)
    return math.log(kept / (1.0 - kept))
