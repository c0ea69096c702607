"""The parts of `pa-console bench`, by name, and the run of those that are asked for."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from rapidfuzz import process

from pa_console.benchmarks.speed.authorization import measure_authorization
from pa_console.benchmarks.speed.checks import measure_checks
from pa_console.benchmarks.speed.compare import Bench, Comparison
from pa_console.benchmarks.speed.decoding import measure_decoding
from pa_console.benchmarks.speed.planner import measure_missions
from pa_console.benchmarks.speed.retrieval_loop import measure_retrieval
from pa_console.benchmarks.speed.simulation import measure_rehearsal, measure_simulation


@dataclass(frozen=True)
class Part:
    """One part of the benchmark."""

    name: str
    about: str
    measure: Callable[[Bench], list[Comparison]]
    needs_model: bool = False


PARTS: tuple[Part, ...] = (
    Part("retrieval", "Retrieval against a plain loop", measure_retrieval),
    Part("checks", "Checks in CEL against plain Python", measure_checks),
    Part("simulation", "Simulation against bare physics", measure_simulation),
    Part("rehearsal", "Rehearsal, fork and forecast", measure_rehearsal),
    Part("authorization", "Commands signed and checked", measure_authorization),
    Part("decoding", "Planner against bare llama.cpp", measure_decoding, needs_model=True),
    Part("missions", "Missions against the plain way", measure_missions, needs_model=True),
)
"""Quick ones first, so that an interrupted run has shown something."""


def choose_parts(names: Sequence[str]) -> tuple[Part, ...]:
    """Return the parts called `names`, all without any; raises ValueError for an unknown name."""
    known = {part.name: part for part in PARTS}
    for name in names:
        if name not in known:
            nearest = process.extractOne(name, list(known), score_cutoff=60)
            hint = f" Did you mean {nearest[0]}?" if nearest else ""
            raise ValueError(
                f"--only {name!r} is no part of the benchmark.{hint} Parts: {', '.join(known)}"
            )
    return tuple(part for part in PARTS if not names or part.name in names)
