"""A plan that may be put to the operator, and how good it is beside others for the same task."""

from dataclasses import dataclass
from typing import NamedTuple

from pa_console.language.mention_check import NOTHING_SAID, MentionCheck
from pa_console.language.order import Reading
from pa_console.language.reading import read_asked, read_reason
from pa_console.llm.roles.grammar import PLANNED
from pa_console.mission.examine import Examination
from pa_console.mission.tasking.fulfilment import gaps
from pa_console.mission.tasking.moves import PlanMoves
from pa_console.mission.tasking.obstacles import unmet_asks
from pa_console.schema.finding import Verdict
from pa_console.schema.world import World
from pa_console.session.confidence import Evidence, SecondAnswer, calibrated_confidence

LIKELIER_OTHERWISE = 0.5
"""Below this confidence the model itself rates its reading as less likely than another one."""

VOUCHED = 0.8
"""A judge with at least this confidence confirms a reading without a confidence of its own."""

UNTOLD = "not known: how sure the server's model is of what was asked"


@dataclass(frozen=True)
class ReadAgain:
    """The second reader's reading, and its confidence in it."""

    asked: str
    confidence: float
    same: bool
    """True if it is the plan's reading, or leads to the same orders."""
    measured: bool = True
    """True if this reader's accuracy was measured: only then can it remove a doubt and decide the
    plan."""


@dataclass(frozen=True)
class Candidate:
    """A plan that went through the safeguards, and the judge's answer once there is one."""

    attempt: int
    examination: Examination
    gaps: tuple[str, ...] = ()
    """The differences between the plan and the planner's own reading."""
    unmet: tuple[str, ...] = ()
    """The parts of that reading that no plan can do now, with the reasons."""
    narrowed: bool = False
    """True if the plan leaves out a part of it that is not true already."""
    mentions: MentionCheck = NOTHING_SAID
    """The words of the order that the reading accounts for."""
    confidence: float | None = None
    """The planner's confidence in its reading."""
    verdict: Verdict | None = None
    judge_error: str = ""
    judge_confidence: float | None = None
    """The judge's confidence in its reading."""
    own: bool = False
    """True if the operator wrote the plan."""
    by_server: bool = False
    """True if the model of a server wrote the plan."""
    read_again: ReadAgain | None = None
    """The second reader's result, if it was asked."""

    @property
    def badness(self) -> tuple[int, ...]:
        """Blocking findings, gaps, then warnings: the smaller the better."""
        blocking, warnings = self.examination.badness
        return blocking, len(self.gaps), warnings

    @property
    def sound(self) -> bool:
        """True if no rule blocks it and it matches its planner's reading."""
        return not any(self.badness[:2])

    @property
    def sure(self) -> float | None:
        """The lower confidence of planner and judge; None if neither reported one."""
        told = (self.confidence, self.judge_confidence)
        return min((sure for sure in told if sure is not None), default=None)

    @property
    def agreed(self) -> float | None:
        """The confidence shown to the operator: how often such a reading is right.

        None unless the second reader, or both others, have read the order by themselves.
        """
        again, gaps = self.read_again, bool(self.mentions.gaps)
        if again is not None and (again.measured or not again.same):
            read = Evidence(self.sure, gaps, self._second(again), again.confidence)
        elif self.confidence is None or self.judge_confidence is None:
            return None
        else:
            read = Evidence(self.sure, gaps)
        return calibrated_confidence(read)

    def _second(self, again: ReadAgain) -> SecondAnswer:
        """Return the second reader's evidence on the plan.

        If the planner reported no confidence, the plan serves the second reader's own reading.
        """
        if not again.same:
            return "other"
        return "alone" if self.sure is None else "same"

    @property
    def gaps_told(self) -> tuple[str, ...]:
        """The evidence against the reading of the order.

        If a server's model reports no confidence, a judge that read the order by itself, and was
        sure, has to confirm it.
        """
        judged = self.judge_confidence
        unknown = self.by_server and self.confidence is None
        untold = unknown and (judged is None or judged < VOUCHED)
        return (*self.mentions.gaps, *(UNTOLD,) * untold)

    @property
    def second_reading(self) -> str:
        """Return the judge's reading if it is the likelier one; '' otherwise.

        It is likelier if the judge objects to the plan and the planner was unsure of its own
        reading and less sure than the judge, or if the plan does nothing: orders are given to be
        carried out, so of two readings the one that leaves nothing to do is the likelier mistake.
        """
        plan, verdict = self.examination.plan, self.verdict
        own = read_reason(plan.reason)
        if verdict is None or not self.objected or _refuses(own):
            return ""
        asked = verdict.feedback.partition(PLANNED)[0]
        judged = read_asked(asked)
        if judged is None:
            return ""
        less = own is not None and len(judged.asks) < len(own.asks)
        sure = self.confidence
        unsure = sure is not None and sure < min(LIKELIER_OTHERWISE, self.judge_confidence or 0.0)
        idle = all(action.verb == "hold" for action in plan.actions)
        return asked if idle or (unsure and not less) else ""

    def does_as(self, other: "Candidate") -> bool:
        """Return whether the plan gives the orders of the `other`, for all of its reading.

        Plans that leave every asset in place do not confirm each other.
        """
        orders = frozenset(self.examination.plan.actions)
        if self.narrowed or self.gaps or all(action.verb == "hold" for action in orders):
            return False
        return orders == frozenset(other.examination.plan.actions)

    @property
    def objected(self) -> bool:
        """True if the judge finds the plan wrong."""
        return self.verdict is not None and self.verdict.verdict == "Failure"


def _refuses(reading: Reading | None) -> bool:
    return reading is not None and any(ask.task == "refused" for ask in reading.asks)


class Fulfilment(NamedTuple):
    """The agreement between a plan and a reading."""

    gaps: tuple[str, ...] = ()
    unmet: tuple[str, ...] = ()
    """The parts of the reading that no plan can do now, with the reasons."""
    narrowed: bool = False
    """True if some of those parts are not true already."""


def fulfilment_of(
    found: Examination, reading: Reading | None, world: World, text: str
) -> Fulfilment:
    """Compare a plan with a `reading` of the order `text`."""
    if reading is None or not reading.readable or found.rehearsal is None:
        return Fulfilment()
    moves = PlanMoves(world, found.rehearsal.before, found.plan)
    unmet = unmet_asks(moves, reading, text)
    return Fulfilment(
        gaps(moves, reading), tuple(one.told for one in unmet), any(not one.so for one in unmet)
    )


def better(first: Candidate | None, other: Candidate) -> Candidate:
    """Return the candidate with less evidence against it; the `first` if they are alike."""
    return other if first is None or other.badness < first.badness else first
