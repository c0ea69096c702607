"""What else an order may mean: offered where planner and judge were unsure of it or read it apart.

Which of several readings is right cannot be told from the models' own chances (README, Measured);
the operator knows what was meant.
"""

from collections.abc import Iterable

from pa_console.llm.grammar import PLANNED
from pa_console.llm.reading import Reading, Wish, asked_words, read_asked
from pa_console.orchestrator.candidate import Candidate
from pa_console.orchestrator.planning import Planning
from pa_console.orchestrator.services import Payloads
from pa_console.schema.event import MOST_READINGS, UNSURE


class Rereading:
    """The readings that are `offered` beside the one on show, the likeliest first."""

    def __init__(self, planning: Planning, looked_at: int) -> None:
        """`looked_at` ways in which the planner might have read the order; 0 offers nothing."""
        self._planning, self._looked_at = planning, looked_at
        self._known: list[str] = []
        self.own = ""
        """What the plan on show is for; '' where nothing else is offered."""
        self.offered: tuple[str, ...] = ()

    async def reconsider(self) -> None:
        """Find what else the order may mean: what the judge has read, and other readings.

        Those are looked for where the models are unsure. What an operator has chosen is not read
        anew: what was read before remains on offer.
        """
        planning, shown = self._planning, self._planning.best
        self.own, self.offered = "", ()
        if shown is None or not self._looked_at:
            return
        own = said_by_planner(shown) or planning.said
        if not planning.chosen:
            self._known = [said_by_judge(shown), planning.said]
            if planning.sure is not None and planning.sure < UNSURE:
                self._known += await planning.other_readings(self._looked_at)
        self.offered = distinct(own, self._known)[:MOST_READINGS]
        self.own = own if self.offered else ""
        self._known = [own, *self.offered] if self.offered else []

    async def choose(self, asked: str) -> Payloads:
        """Plan again, for what the operator says was `asked`."""
        async for payload in self._planning.plan_for(asked):
            yield payload


def said_by_planner(shown: Candidate) -> str:
    """Return what the plan on show says was asked, '' without that."""
    return asked_words(shown.examination.plan.reason).rstrip("; ")


def said_by_judge(shown: Candidate) -> str:
    """Return what the verdict on it says was asked, '' without that."""
    said, planned, _ = shown.verdict.feedback.partition(PLANNED) if shown.verdict else ("", "", "")
    return said if planned else ""


def read_apart(shown: Candidate) -> bool:
    """Whether the judge says that something else was asked than the plan on show is for."""
    judged = said_by_judge(shown)
    return bool(judged) and bool(distinct(said_by_planner(shown), (judged,)))


def distinct(own: str, others: Iterable[str]) -> tuple[str, ...]:
    """Return those of `others` that can be read and ask now for something else than `own`.

    Of those that ask for the same, the first.
    """
    known, kept = [_asks(own)], list[str]()
    for said in others:
        asks = _asks(said)
        if asks is not None and asks not in known:
            known.append(asks)
            kept.append(said)
    return tuple(kept)


def _asks(said: str) -> Reading | None:
    """Return what is asked for now, however it was put; None where nothing is gained by asking.

    So it is where that cannot be read, or is all what no order may have, and where somebody is sent
    to where he comes from.
    """
    reading = read_asked(said)
    if reading is None or not reading.readable:
        return None
    if reading.wishes and all(wish.task == "refused" for wish in reading.wishes):
        return None
    if any(wish.team.origin and wish.team.origin == wish.place for wish in reading.wishes):
        return None
    return reading._replace(wishes=tuple(map(_without_words, reading.wishes)))


def _without_words(wish: Wish) -> Wish:
    """Return `wish` however it was put: whoever a gate has lost, it is the gate that is covered."""
    return wish._replace(words="", leaving="" if wish.task == "cover" else wish.leaving)
