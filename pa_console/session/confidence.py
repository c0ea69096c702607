"""The chance that a reading of an order is right, given who has read it so.

A model's own chance means little by itself: a reading with a chance of 40 % is nearly always right
if a second reader agrees, and far less often if it disagrees. The readings of an order therefore
compete. Each has a weight of evidence, to which every reader who shares it adds; its chance is its
share in the weights of all readings and of one more possibility, that none of them is right (a
conditional logit). A greater chance of a reader never lowers it, and a gap never raises it.

The weights are fitted to 336 generated orders that no model has seen in training: 180 of the seeds
434 and 436, most of them in people's own words, and 156 of the seed 438 in held-out words.
Cross-validated by situation, the expected calibration error is 0.04. To fit them again:

    python -m pa_training.confidence.read_orders --out ORDERS.jsonl
    python -m pa_training.confidence.fit ORDERS.jsonl

The confidence alone approves nothing: after a gap, and beside another reading that may be right, a
plan cannot be approved without a warning at any confidence (`mission/approval.py`).
"""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

Reader = Literal["planner", "judge", "second"]
"""A model that reads an order: the planner, the judge, or the second reader."""

UNSURE = 0.8
"""The confidence below which an order may be misunderstood."""

LEAST_CHANCE, MOST_CHANCE = 0.01, 0.99
"""Bounds of a chance: the last per mille of a model's chance have no meaning."""


class Evidence(NamedTuple):
    """The evidence for one reading of an order."""

    planner: float | None = None
    """The planner's chance of it; None if the planner reads something else, or reports none."""
    judge: float | None = None
    second: float | None = None
    gaps: int = 0
    """The number of words that it leaves over, and of names and tasks that no word supports."""

    @property
    def told(self) -> dict[Reader, float]:
        """The probabilities from the readers with this reading, if they report any."""
        told: dict[Reader, float | None] = {
            "planner": self.planner,
            "judge": self.judge,
            "second": self.second,
        }
        return {reader: chance for reader, chance in told.items() if chance is not None}


class WeighedReading(NamedTuple):
    """A reading of an order, the reader whose words it has, and how likely it is right."""

    asked: str
    reader: Reader
    evidence: Evidence
    chance: float = 0.0


class Coefficients(NamedTuple):
    """Weights of the evidence for a reading, in log odds."""

    constant: float = 0.0
    both: float = 0.0
    """The weight of a reading that planner and judge share."""
    odds: float = 0.0
    """The factor of the log odds of the lower of their chances."""
    second: float = 0.0
    """The weight of a reading of the second reader."""
    second_odds: float = 0.0
    """The factor of the log odds of its chance."""
    gaps: float = 0.0
    """The weight of each gap beyond those of the reading with the fewest."""


FITTED = Coefficients(1.034, 0.147, 0.425, 0.083, 0.513, -1.409)

MOST_DOUBTED = 0.75
"""The most confidence in a reading with a gap that no second reader confirms, and in a reading of
the second reader alone: it was trained on phrasings like those of the fitted orders, so it is right
more often there than elsewhere."""

MOST_GAPS = 3
"""More gaps count as these."""


def features(readings: Sequence[Evidence]) -> list[tuple[float, ...]]:
    """Return the factors of the coefficients, in their order, for each reading of one order."""
    gaps = [min(read.gaps, MOST_GAPS) for read in readings]
    found = list[tuple[float, ...]]()
    for read, count in zip(readings, gaps, strict=True):
        own = [chance for chance in (read.planner, read.judge) if chance is not None]
        second = [read.second] if read.second is not None else []
        odds = [log_odds(min(told)) if told else 0.0 for told in (own, second)]
        more = float(count - min(gaps))
        found.append((1.0, float(len(own) > 1), odds[0], float(len(second)), odds[1], more))
    return found


def chances(readings: Sequence[Evidence], by: Coefficients = FITTED) -> list[float]:
    """Return the chance of each of the `readings` of one order; at most 1 together."""
    weights = [
        math.exp(sum(factor * weight for factor, weight in zip(each, by, strict=True)))
        for each in features(readings)
    ]
    total = 1.0 + sum(weights)
    return [
        round(min(weight / total, MOST_DOUBTED if _doubted(read) else 1.0), 4)
        for read, weight in zip(readings, weights, strict=True)
    ]


def _doubted(read: Evidence) -> bool:
    """Return whether a reading with a gap, or of the second reader, is unconfirmed."""
    return read.gaps > 0 if read.second is None else len(read.told) == 1


def calibrated_confidence(read: Evidence) -> float | None:
    """Return the chance of a reading that is the only one; None if no reader reports a chance."""
    return chances([read])[0] if read.told else None


def weighed(readings: Sequence[WeighedReading]) -> tuple[WeighedReading, ...]:
    """Return all `readings` of one order with their chances, the likeliest first."""
    told = chances([reading.evidence for reading in readings])
    found = [one._replace(chance=chance) for one, chance in zip(readings, told, strict=True)]
    return tuple(sorted(found, key=lambda reading: -reading.chance))


RIVAL = 0.1
"""The chance of another reading from which an order is in doubt."""


def read_apart(served: WeighedReading, readings: Sequence[WeighedReading]) -> bool:
    """Return True if another of `readings` is likely enough to be right instead of `served`.

    It may if its chance is not small or nobody measured it, or if one reader alone has read what is
    served.
    """
    others = [each for each in readings if each != served]
    if others and len(served.evidence.told) < 2:
        return True
    return any(not each.evidence.told or each.chance >= RIVAL for each in others)


def log_odds(chance: float) -> float:
    """Return the logarithm of the odds of a `chance`, which is bounded away from certainty."""
    kept = min(max(chance, LEAST_CHANCE), MOST_CHANCE)
    return math.log(kept / (1.0 - kept))
