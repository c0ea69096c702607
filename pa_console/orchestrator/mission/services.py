"""What every mission is worked on with, and the stopwatch that its metrics come from."""

from collections.abc import AsyncIterator, Generator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import Self

from pa_console.fleets.fleet import Fleet
from pa_console.llm.engine.engine import Engine
from pa_console.llm.roles.dialect import DIALECTS, Dialect
from pa_console.llm.roles.judge import Judge
from pa_console.llm.roles.planner import Planner
from pa_console.orchestrator.execution.command_gate import CommandGate
from pa_console.orchestrator.intake.spelling_correction import respell
from pa_console.orchestrator.station.journal import Journal
from pa_console.policy.checks.sightings import Sightings
from pa_console.policy.retrieval.retriever import Retriever
from pa_console.policy.rulebook import Rulebook
from pa_console.policy.trust.core_rules import with_core
from pa_console.schema.evaluation import Variant
from pa_console.schema.events.event import EventPayload
from pa_console.schema.mission import Metrics

Payloads = AsyncIterator[EventPayload]


@dataclass(frozen=True)
class Services:
    """The fleet, the policy and the two roles of the LLM; `variant` says what takes part.

    Everything does, but for ablations: they run in evaluations only, never in the console.
    """

    fleet: Fleet
    rulebook: Rulebook
    retriever: Retriever
    engine: Engine
    planner: Planner
    judge: Judge
    top_k: int = 3
    variant: Variant = field(default_factory=Variant)
    dialect: Dialect = DIALECTS["examples"]
    journal: Journal = field(default_factory=Journal)
    sightings: Sightings = field(init=False)
    """What was seen where in this session; the station keeps it."""
    gate: CommandGate = field(init=False)
    """What every command to a device goes through: `fleet.send` is for the gate alone."""

    def __post_init__(self) -> None:
        """Begin with nothing seen or decided, and with the core in force whatever the rules say."""
        object.__setattr__(self, "rulebook", with_core(self.rulebook))
        object.__setattr__(self, "sightings", Sightings(self.fleet.world))
        object.__setattr__(self, "gate", CommandGate(self.fleet, self.journal))

    def read(self, text: str) -> str:
        """Return the words of a mission with what is misspelt put right."""
        return respell(text, self.fleet.world, self.rulebook)

    def with_rules(self, rulebook: Rulebook) -> Self:
        """Return the same with other rules; what was seen is kept, and what was decided."""
        changed = replace(self, rulebook=rulebook, retriever=self.retriever.over(rulebook.rules))
        object.__setattr__(changed, "sightings", self.sightings)
        object.__setattr__(changed, "gate", self.gate)
        return changed


@dataclass
class Stopwatch:
    """Adds up the seconds of each stage under the names of the Metrics fields."""

    seconds: dict[str, float] = field(default_factory=dict[str, float])
    started: float = field(default_factory=perf_counter)

    def add(self, stage: str, seconds: float) -> None:
        """Add `seconds` to `stage`."""
        self.seconds[stage] = self.seconds.get(stage, 0.0) + seconds

    @contextmanager
    def time(self, stage: str) -> Generator[None]:
        """Add the wall time of the block to `stage`."""
        begin = perf_counter()
        try:
            yield
        finally:
            self.add(stage, perf_counter() - begin)

    def metrics(self, attempts: int, plans: int = 0, halts: int = 0) -> Metrics:
        """Return everything measured so far, end to end until now."""
        return Metrics.model_validate(
            {
                **self.seconds,
                "end_to_end_s": perf_counter() - self.started,
                "attempts": attempts,
                "plans": plans,
                "halts": halts,
            }
        )
