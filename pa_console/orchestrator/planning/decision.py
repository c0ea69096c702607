"""Step 6 of a mission: judge the best plan, ask the operator, take another plan or reading.

Which of several readings is right cannot be told from the models' own chances (README, Measured);
the operator knows what was meant.
"""

from collections.abc import Awaitable, Callable, Iterable
from dataclasses import replace

from pa_console.llm.roles.grammar import PLANNED
from pa_console.orchestrator.execution.premises import way_to_safety
from pa_console.orchestrator.mission.services import Payloads, Stopwatch
from pa_console.orchestrator.planning.approval import inadmissible, request_approval
from pa_console.orchestrator.planning.candidate import Candidate
from pa_console.orchestrator.planning.planning import Planning
from pa_console.orders.order import Ask, Reading
from pa_console.orders.reading import asked_words, read_asked
from pa_console.schema.events import event as ev
from pa_console.schema.events.event import MOST_READINGS, UNSURE
from pa_console.schema.mission import Decision, Mission, MissionStatus
from pa_console.schema.plan import Action
from pa_console.schema.world import World

Decide = Callable[[], Awaitable[Decision]]


class Deciding:
    """Asks until there is an admissible decision; `approved` is the plan to execute, if any."""

    def __init__(
        self,
        planning: Planning,
        mission: Mission,
        world: World,
        decide: Decide,
        stopwatch: Stopwatch,
        *,
        judging: bool = True,
        readings: int = 0,
    ) -> None:
        """`decide` is awaited for the operator's answer once approval was requested.

        Without `judging` no verdict is asked for (benchmarks only). Where the models are unsure of
        what was asked, `readings` ways to read it are looked at.
        """
        self._planning, self._mission, self._judging = planning, mission, judging
        self._world = world
        self._rereading = Rereading(planning, readings)
        self._decide, self._watch = decide, stopwatch
        self.approved: Candidate | None = None
        self.request: ev.ApprovalRequested | None = None
        """What was asked last; `decision` is the answer to it."""
        self.decision: Decision | None = None
        self.status: MissionStatus = "held"
        self.reason = ""
        """With no plan approved: what the mission comes to, and why."""

    async def settle(self) -> Payloads:
        """Judge and ask; go round again for the operator's own plan, or reading of the order."""
        self.approved = None
        while True:
            candidate = self._planning.best
            if candidate is None:
                self.status = "held"
                self.reason = self._planning.error or "the planner gave no plan"
                return
            async for payload in self._planning.judge():
                yield payload
            candidate = self._planning.best or candidate
            await self._rereading.reconsider()
            found = candidate.examination
            request = request_approval(
                f"{self._mission.id}.{candidate.attempt}",
                candidate.attempt,
                found.plan,
                found.findings,
                candidate.verdict,
                candidate.judge_error,
                judging=self._judging,
                asked=self._rereading.own,
                readings=self._rereading.offered,
                if_halted=self._way_to_safety(candidate),
                gaps=candidate.mentions.gaps,
                confidence=self._planning.agreed,
                read_apart=read_apart(candidate),
            )
            self.request = request
            yield request
            decision = self.decision = None
            while decision is None:
                with self._watch.time("decision_s"):
                    answer = await self._decide()
                problem = inadmissible(request, answer)
                yield ev.DecisionMade(
                    attempt=candidate.attempt,
                    decision=answer,
                    accepted=not problem,
                    detail=problem,
                )
                decision = self.decision = None if problem else answer
            if decision.kind == "approve":
                self.approved = candidate
                return
            if decision.kind == "choose":
                async for payload in self._rereading.choose(decision.asked):
                    yield payload
                continue
            if decision.kind == "reject" or decision.plan is None:
                self._reject(candidate, request, decision)
                return
            async for payload in self._planning.take(decision.plan):
                yield payload

    def _way_to_safety(self, candidate: Candidate) -> tuple[Action, ...]:
        """Return what is approved with a plan: what its agents do if it is halted."""
        rehearsal = candidate.examination.rehearsal
        if rehearsal is None:
            return ()
        return way_to_safety(candidate.examination.plan, self._world, rehearsal.before)

    def _reject(
        self, candidate: Candidate, request: ev.ApprovalRequested, decision: Decision
    ) -> None:
        if candidate.examination.blocked:
            self.status, self.reason = "refused", "; ".join(request.blocked_by)
        elif request.blocked_by:
            self.status, self.reason = "held", "; ".join(request.blocked_by)
        else:
            self.status = "rejected"
            self.reason = decision.reason or f"rejected by {decision.by}"


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
    if reading.asks and all(ask.task == "refused" for ask in reading.asks):
        return None
    if any(ask.who.origin and ask.who.origin == ask.place for ask in reading.asks):
        return None
    return reading._replace(asks=tuple(map(_without_words, reading.asks)))


def _without_words(ask: Ask) -> Ask:
    """Return `ask` however it was put: whoever a gate has lost, it is the gate that is covered.

    A track is known by its place, and what no order may have is refused whatever it is.
    """
    leaving = "" if ask.task == "cover" else ask.leaving
    return replace(ask, words="", leaving=leaving, track="", track_id="", wrong=None)
