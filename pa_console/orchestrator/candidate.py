"""A plan that may be put to the operator, and how good it is beside others for the same task."""

from dataclasses import dataclass

from pa_console.orchestrator.safeguards import Examination
from pa_console.schema.finding import Verdict


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
