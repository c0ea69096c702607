"""Step 6 of a mission: judge the best plan, ask the operator, take another plan or reading."""

from collections.abc import Awaitable, Callable

from pa_console.orchestrator.approval import inadmissible, request_approval
from pa_console.orchestrator.candidate import Candidate
from pa_console.orchestrator.planning import Planning
from pa_console.orchestrator.premises import way_to_safety
from pa_console.orchestrator.rereading import Rereading, read_apart
from pa_console.orchestrator.services import Payloads, Stopwatch
from pa_console.schema import event as ev
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
