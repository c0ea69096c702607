"""How sure the operator is told that the console is of an order: how often one read so is right.

A model's own chance says little by itself: where a second reader says the same, an order of which
the planner gave its reading 40 % is nearly always right; where it says something else, far less
often. So what is told is a logistic function of what is known of the reading. It was fitted to
orders of which the right reading is known; `pa_console.training.confidence` fits it again, and
the manual's page on models says to what. It is monotone: a greater chance never makes it less, a
gap never more.

What is told decides nothing alone: a gap, or readers who differ, keep a plan from being plainly
approved however sure it is told to be (`orchestrator/planning/approval.py`).
"""

import math
from typing import Literal, NamedTuple

Second = Literal["", "same", "other", "alone"]
"""What the second reader says: nothing, what the plan is for, something else; or the plan is for
what it alone has read."""

UNSURE = 0.85
"""Told to be less sure than this, an order may be misunderstood."""

LEAST_CHANCE, MOST_CHANCE = 0.01, 0.99
"""Chances beyond these are taken for these: a model's last per mille say nothing."""


class Coefficients(NamedTuple):
    """Weights of what is known of a reading, in log odds."""

    unasked: float
    """Without a second reader's answer."""
    same: float
    other: float
    alone: float
    chance: float
    """By the log odds of the chance that planner and judge gave, the lower one."""
    chance_same: float
    """The same where the second reader says the same."""
    second_chance: float
    """By the log odds of the second reader's, where the plan is for what it says."""
    gaps: float
    """Where words of the order and its reading do not match."""


FITTED = Coefficients(1.5, 2.5, -0.5, 0.0, 0.8, 0.4, 0.2, -1.0)


class Evidence(NamedTuple):
    """What is known of how an order was read."""

    chance: float | None
    """Of planner and judge, the lower one; None where neither tells."""
    gaps: bool = False
    second: Second = ""
    second_chance: float = 0.0


def told_confidence(read: Evidence, by: Coefficients = FITTED) -> float | None:
    """Return how often an order that was `read` so is right, 0 to 1; None where nobody tells."""
    if read.chance is None and not read.second:
        return None
    odds = {"": by.unasked, "same": by.same, "other": by.other, "alone": by.alone}[read.second]
    if read.second != "alone":
        slope = by.chance_same if read.second == "same" else by.chance
        odds += slope * log_odds(read.chance or 0.0)
    if read.second in ("same", "alone"):
        odds += by.second_chance * log_odds(read.second_chance)
    odds += by.gaps * read.gaps
    return round(1.0 / (1.0 + math.exp(-odds)), 4)


def log_odds(chance: float) -> float:
    """Return the logarithm of the odds of a `chance`, which is kept from certainty."""
    kept = min(max(chance, LEAST_CHANCE), MOST_CHANCE)
    return math.log(kept / (1.0 - kept))
