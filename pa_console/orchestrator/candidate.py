"""A plan that may be put to the operator, and how good it is beside others for the same task."""

from dataclasses import dataclass

from pa_console.llm.reading import Reading
from pa_console.orchestrator.fulfilment import gaps
from pa_console.orchestrator.plan_moves import PlanMoves
from pa_console.orchestrator.safeguards import Examination
from pa_console.schema.finding import Verdict
from pa_console.schema.world import World


@dataclass
class Candidate:
    """A plan that went through the safeguards, and the judge's answer once there is one."""

    attempt: int
    examination: Examination
    gaps: tuple[str, ...] = ()
    """In which points the plan is not what the planner itself says was asked."""
    verdict: Verdict | None = None
    judge_error: str = ""

    @property
    def badness(self) -> tuple[int, ...]:
        """Blocking findings, gaps, then warnings: the smaller the better."""
        blocking, warnings = self.examination.badness
        return blocking, len(self.gaps), warnings

    @property
    def objected(self) -> bool:
        """Whether the judge says that the plan is not right."""
        return self.verdict is not None and self.verdict.verdict == "Failure"


def missing(found: Examination, reading: Reading | None, world: World) -> tuple[str, ...]:
    """Return in which points a plan is not what was asked, as far as `reading` tells that."""
    if reading is None or not reading.readable or found.rehearsal is None:
        return ()
    return gaps(PlanMoves(world, found.rehearsal.before, found.plan), reading)
