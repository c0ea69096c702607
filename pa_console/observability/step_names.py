"""The names of a mission's steps, for traces, metrics and benchmarks alike."""

from typing import Literal

Step = Literal[
    "intake",
    "retrieve",
    "picture",
    "prompt",
    "plan",
    "rehearse",
    "safeguards",
    "judge",
    "read_again",
    "decide",
    "execute",
    "verify",
    "outcome",
    "report",
]
"""The eight steps: 1 intake, 2 retrieve, 3 picture, 4 prompt, 5 plan, 6 rehearse to decide,
7 execute to outcome, 8 report."""

NUMBERS: dict[Step, int] = {
    "intake": 1,
    "retrieve": 2,
    "picture": 3,
    "prompt": 4,
    "plan": 5,
    "rehearse": 6,
    "safeguards": 6,
    "judge": 6,
    "read_again": 6,
    "decide": 6,
    "execute": 7,
    "verify": 7,
    "outcome": 7,
    "report": 8,
}
"""The number of each step among the eight."""
