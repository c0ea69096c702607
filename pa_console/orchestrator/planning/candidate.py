"""A plan that may be put to the operator, and how good it is beside others for the same task."""

from dataclasses import dataclass
from typing import NamedTuple

from pa_console.llm.roles.grammar import PLANNED
from pa_console.orchestrator.planning.plan_moves import PlanMoves
from pa_console.orchestrator.planning.safeguards import Examination
from pa_console.orchestrator.tasking.fulfilment import gaps
from pa_console.orchestrator.tasking.obstacles import unmet_asks
from pa_console.orders.mention_check import NOTHING_SAID, MentionCheck
from pa_console.orders.order import Reading
from pa_console.orders.reading import read_asked, read_reason
from pa_console.schema.finding import Verdict
from pa_console.schema.world import World
from pa_console.session.confidence import Evidence, SecondAnswer, calibrated_confidence

LIKELIER_OTHERWISE = 0.5
"""Below this chance, something else was asked, in the model's own eyes, than what it wrote."""

VOUCHED = 0.8
"""A judge at least so sure bears out how a model read an order that tells no chance of its own."""

UNTOLD = "not known: how sure the server's model is of what was asked"


@dataclass(frozen=True)
class ReadAgain:
    """What the second reader says was asked, and the chance that it gave to that."""

    asked: str
    confidence: float
    same: bool
    """Whether that is what the plan is for, or comes to the same orders."""
    measured: bool = True
    """Whether it was measured how often this reader is right: only then can it take a doubt away,
    and decide what is planned."""


@dataclass(frozen=True)
class Candidate:
    """A plan that went through the safeguards, and the judge's answer once there is one."""

    attempt: int
    examination: Examination
    gaps: tuple[str, ...] = ()
    """In which points the plan is not what the planner itself says was asked."""
    unmet: tuple[str, ...] = ()
    """What of that no plan can do now, and why."""
    narrowed: bool = False
    """Whether the plan leaves out a part of it that is not so already."""
    mentions: MentionCheck = NOTHING_SAID
    """Whether that accounts for the words of the order."""
    confidence: float | None = None
    """The chance that its planner gave to what it says was asked."""
    verdict: Verdict | None = None
    judge_error: str = ""
    judge_confidence: float | None = None
    """The chance that the judge gave to what it says was asked."""
    own: bool = False
    """Whether the operator wrote it."""
    by_server: bool = False
    """Whether the model of a server wrote it."""
    read_again: ReadAgain | None = None
    """What the second reader says, where it was asked."""

    @property
    def badness(self) -> tuple[int, ...]:
        """Blocking findings, gaps, then warnings: the smaller the better."""
        blocking, warnings = self.examination.badness
        return blocking, len(self.gaps), warnings

    @property
    def sound(self) -> bool:
        """Whether nothing blocks it, and it is what its planner says was asked."""
        return not any(self.badness[:2])

    @property
    def sure(self) -> float | None:
        """How sure planner and judge were of what was asked; None: they did not tell."""
        told = (self.confidence, self.judge_confidence)
        return min((sure for sure in told if sure is not None), default=None)

    @property
    def agreed(self) -> float | None:
        """How often an order that was read so is right, as the operator is told.

        None where neither the second reader nor both others have read the order for themselves.
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
        """Return what the second reader says of the plan.

        Without a chance of the planner's, the plan is for what the second reader alone has read.
        """
        if not again.same:
            return "other"
        return "alone" if self.sure is None else "same"

    @property
    def gaps_told(self) -> tuple[str, ...]:
        """What speaks against the order having been understood.

        A server's model that does not tell how sure it is has to be borne out by a judge who read
        the order for itself and was sure.
        """
        judged = self.judge_confidence
        unknown = self.by_server and self.confidence is None
        untold = unknown and (judged is None or judged < VOUCHED)
        return (*self.mentions.gaps, *(UNTOLD,) * untold)

    @property
    def second_reading(self) -> str:
        """What the judge says was asked, where it is the likelier reading; '' otherwise.

        It objects to the plan, and the planner was unsure of its own reading and less sure than
        the judge, or the plan does nothing: orders are given to be carried out, so of two readings
        the one after which nothing is left to do is the likelier mistake. Of two chances the better
        one says nothing where the judge's reading asks for less: what is left out costs none. A
        refusal of what no order may have done stands.
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
        """Whether the plan gives the orders of the `other`, for all of what it is for.

        Plans that leave everybody where they are bear each other out in nothing.
        """
        orders = frozenset(self.examination.plan.actions)
        if self.narrowed or self.gaps or all(action.verb == "hold" for action in orders):
            return False
        return orders == frozenset(other.examination.plan.actions)

    @property
    def objected(self) -> bool:
        """Whether the judge says that the plan is not right."""
        return self.verdict is not None and self.verdict.verdict == "Failure"


def _refuses(reading: Reading | None) -> bool:
    return reading is not None and any(ask.task == "refused" for ask in reading.asks)


class Fulfilment(NamedTuple):
    """How far a plan is what was asked."""

    gaps: tuple[str, ...] = ()
    unmet: tuple[str, ...] = ()
    """What of it no plan can do now, and why."""
    narrowed: bool = False
    """Whether some of that is not so already."""


def fulfilment_of(
    found: Examination, reading: Reading | None, world: World, text: str
) -> Fulfilment:
    """Compare a plan with what was asked, as far as `reading` of the order `text` tells that."""
    if reading is None or not reading.readable or found.rehearsal is None:
        return Fulfilment()
    moves = PlanMoves(world, found.rehearsal.before, found.plan)
    unmet = unmet_asks(moves, reading, text)
    return Fulfilment(
        gaps(moves, reading), tuple(one.told for one in unmet), any(not one.so for one in unmet)
    )


def better(first: Candidate | None, other: Candidate) -> Candidate:
    """Return the one that there is less to say against, the `first` of two that are alike."""
    return other if first is None or other.badness < first.badness else first
