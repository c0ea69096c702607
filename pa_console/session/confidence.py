"""The chance that a reading of an order is right, given the readers that have it.

The chance that one model reports means little by itself: a reading with a chance of 40 % is nearly
always right if a second reader agrees, and far less often if it disagrees. The readings of an order
therefore compete. Each reading has a weight of evidence, to which every reader that has the reading
adds. The chance of a reading is its share of the total weight, which includes the possibility that
no reading is right (a conditional logit). A higher chance from a reader never lowers the result,
and a gap never raises it.

The weights are fitted to 336 generated orders that no model has seen in training: 180 from the
seeds 434 and 436, most of them in people's own words, and 156 from the seed 438 in held-out words.
In cross-validation by situation, the expected calibration error is 0.04. To fit the weights again:

    python -m pa_training.confidence.read_orders --out ORDERS.jsonl
    python -m pa_training.confidence.fit ORDERS.jsonl

High confidence alone does not prevent a warning: if there is a gap, or if another reading may be
right, the operator is warned at any confidence (`mission/approval.py`).
"""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

Reader = Literal["planner", "judge", "second"]
"""A model that reads an order: the planner, the judge, or the second reader."""

UNSURE = 0.8
"""The confidence below which an order counts as possibly misread."""

LEAST_CHANCE, MOST_CHANCE = 0.01, 0.99
"""The bounds of a model's chance; a chance beyond them counts as the bound."""

MOST_DOUBTED = 0.75
"""The greatest confidence in a reading with a gap that the second reader does not share, and in a
reading that only the second reader has. The second reader was trained on phrasings like those of
the fitted orders, so it is right more often there than elsewhere."""

MOST_GAPS = 3
"""The largest number of gaps that is counted."""
RIVAL = 0.1
"""The least chance of another reading with which an order counts as doubtful."""


class Evidence(NamedTuple):
    """The evidence for one reading of an order."""

    planner: float | None = None
    """The planner's confidence in this reading; None if it has another reading or no confidence."""
    judge: float | None = None
    second: float | None = None
    gaps: int = 0
    """The number of the order's unused words, plus the reading's names and tasks without a word."""

    @property
    def chances(self) -> dict[Reader, float]:
        """The chance from each reader that has this reading and reports a chance."""
        chances: dict[Reader, float | None] = {
            "planner": self.planner,
            "judge": self.judge,
            "second": self.second,
        }
        return {reader: chance for reader, chance in chances.items() if chance is not None}


class WeighedReading(NamedTuple):
    """A reading of an order, the reader that worded it, and the chance that it is right."""

    asked: str
    reader: Reader
    evidence: Evidence
    chance: float = 0.0


class Coefficients(NamedTuple):
    """The weights of the evidence for a reading, in log odds."""

    constant: float = 0.0
    both: float = 0.0
    """The weight of a reading that planner and judge share."""
    odds: float = 0.0
    """The weight of the log odds of the lower of planner's and judge's chances."""
    second: float = 0.0
    """The weight of a reading that the second reader has."""
    second_odds: float = 0.0
    """The weight of the log odds of the second reader's chance."""
    gaps: float = 0.0
    """The weight of each gap by which a reading exceeds the reading with the fewest gaps."""


FITTED = Coefficients(1.034, 0.147, 0.425, 0.083, 0.513, -1.409)


def features(readings: Sequence[Evidence]) -> list[tuple[float, ...]]:
    """Return the input of each coefficient, in their order, for each reading of one order."""
    gaps = [min(read.gaps, MOST_GAPS) for read in readings]
    rows = list[tuple[float, ...]]()
    for read, count in zip(readings, gaps, strict=True):
        own = [chance for chance in (read.planner, read.judge) if chance is not None]
        second = [read.second] if read.second is not None else []
        odds = [log_odds(min(chances)) if chances else 0.0 for chances in (own, second)]
        more = float(count - min(gaps))
        rows.append((1.0, float(len(own) > 1), odds[0], float(len(second)), odds[1], more))
    return rows


def chances(readings: Sequence[Evidence], by: Coefficients = FITTED) -> list[float]:
    """Return the chance of each of the `readings` of one order; their sum is at most 1."""
    weights = [
        math.exp(sum(factor * weight for factor, weight in zip(row, by, strict=True)))
        for row in features(readings)
    ]
    total = 1.0 + sum(weights)
    return [
        round(min(weight / total, MOST_DOUBTED if _doubted(read) else 1.0), 4)
        for read, weight in zip(readings, weights, strict=True)
    ]


def _doubted(read: Evidence) -> bool:
    """Return True if a reading has too little support.

    It has too little if only the second reader has it, or if it has a gap and the second reader
    does not share it.
    """
    return read.gaps > 0 if read.second is None else len(read.chances) == 1


def calibrated_confidence(read: Evidence) -> float | None:
    """Return the chance of the only reading of an order; None if no reader reports a chance."""
    return chances([read])[0] if read.chances else None


def weighed(readings: Sequence[WeighedReading]) -> tuple[WeighedReading, ...]:
    """Return all `readings` of one order with their chances, the likeliest first."""
    likelihoods = chances([reading.evidence for reading in readings])
    with_chances = [
        reading._replace(chance=chance)
        for reading, chance in zip(readings, likelihoods, strict=True)
    ]
    return tuple(sorted(with_chances, key=lambda reading: -reading.chance))


def read_apart(served: WeighedReading, readings: Sequence[WeighedReading]) -> bool:
    """Return True if another of `readings` may be right instead of `served`.

    Another reading may be right if its chance is at least RIVAL or unknown, or if only one reader
    has the reading that is served.
    """
    others = [reading for reading in readings if reading != served]
    if others and len(served.evidence.chances) < 2:
        return True
    return any(not reading.evidence.chances or reading.chance >= RIVAL for reading in others)


def log_odds(chance: float) -> float:
    """Return the log odds of `chance`, first limited to LEAST_CHANCE and MOST_CHANCE."""
    kept = min(max(chance, LEAST_CHANCE), MOST_CHANCE)
    return math.log(kept / (1.0 - kept))
