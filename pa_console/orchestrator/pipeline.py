"""The eight steps for one mission, as a stream of event payloads (paper, Section III)."""

from collections.abc import Awaitable, Callable
from time import perf_counter

from pa_console.orchestrator.approval import inadmissible, request_approval
from pa_console.orchestrator.execution import Execution
from pa_console.orchestrator.feed import StepFeed
from pa_console.orchestrator.planning import Candidate, Planning
from pa_console.orchestrator.report import brief_report
from pa_console.orchestrator.services import Payloads, Services, Stopwatch
from pa_console.policy.checks import check_mission
from pa_console.schema import event as ev
from pa_console.schema.mission import Decision, Mission, MissionStatus

MAX_VOIDED = 2
Decide = Callable[[], Awaitable[Decision]]


class MissionRun:
    """Works on one mission from retrieval to report; the caller logs and shows what it yields."""

    def __init__(
        self, services: Services, mission: Mission, feed: StepFeed, decide: Decide
    ) -> None:
        """`decide` is awaited for the operator's answer once approval was requested."""
        self.mission = mission
        self._services, self._decide = services, decide
        self._watch = Stopwatch()
        self._planning = Planning(services, mission, self._watch)
        self.execution = Execution(services, mission, self._watch, feed)
        self._approved: Candidate | None = None
        self._status: MissionStatus = "held"
        self._reason = ""

    async def payloads(self) -> Payloads:
        """Yield everything that happens; a plan is executed only after an admissible approval."""
        yield ev.MissionStarted()
        async for payload in self._planning.retrieve():
            yield payload
        async for payload in self._until_approved():
            yield payload
        if self._approved is not None:
            async for payload in self._carry_out(self._approved):
                yield payload
        for payload in self.close(self._status, self._reason):
            yield payload

    def close(
        self, status: MissionStatus, reason: str
    ) -> tuple[ev.MissionReported, ev.MissionFinished]:
        """Return the report and the end of the mission."""
        approved = self._approved.examination.plan if self._approved is not None else None
        text = brief_report(
            self.mission,
            status=status,
            reason=reason,
            plan=approved,
            verification=self.execution.verification,
            picture=self._services.sim.picture(),
        )
        metrics = self._watch.metrics(self._planning.attempts)
        finished = ev.MissionFinished(status=status, reason=reason, metrics=metrics)
        return ev.MissionReported(text=text), finished

    async def _until_approved(self) -> Payloads:
        """Steps 1 (policy at intake) to 6: plan, decide, and plan again if the world moved."""
        refused = await self._refused_at_intake()
        if refused is not None:
            yield refused
            return
        reasons: tuple[str, ...] = ()
        previous = ""
        for _ in range(MAX_VOIDED):
            async for payload in self._planning.propose(reasons, previous):
                yield payload
            async for payload in self._settle():
                yield payload
            candidate = self._approved
            if candidate is None:
                return
            fresh = await self._planning.reexamine()
            if fresh is None:
                return
            self._approved = None
            self._status = "held"
            self._reason = f"the situation changed: {'; '.join(fresh.broken)}"
            yield ev.PlanVoided(attempt=candidate.attempt, reason=self._reason)
            reasons, previous = fresh.broken, fresh.plan.model_dump_json()

    async def _refused_at_intake(self) -> ev.PlanChecked | None:
        """Decide the rules that concern the mission's words alone, before any model is asked."""
        services = self._services
        started = perf_counter()
        findings = check_mission(services.rulebook, self.mission, services.sim.world)
        seconds = perf_counter() - started
        self._watch.add("checks_s", seconds)
        blocking = [f"{f.rule_id}: {f.message}" for f in findings if f.blocking]
        if not blocking:
            return None
        self._status, self._reason = "refused", "; ".join(blocking)
        return ev.PlanChecked(attempt=1, findings=findings, seconds=seconds)

    async def _settle(self) -> Payloads:
        """Step 6: judge, ask the operator, and go round again for a plan of the operator's own."""
        while True:
            candidate = self._planning.best
            if candidate is None:
                self._status = "held"
                self._reason = self._planning.error or "the planner gave no plan"
                return
            async for payload in self._planning.judge():
                yield payload
            found = candidate.examination
            request = request_approval(
                f"{self.mission.id}.{candidate.attempt}",
                candidate.attempt,
                found.plan,
                found.findings,
                candidate.verdict,
                candidate.judge_error,
            )
            yield request
            decision: Decision | None = None
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
                decision = None if problem else answer
            if decision.kind == "approve":
                self._approved = candidate
                return
            if decision.kind == "reject" or decision.plan is None:
                self._reject(candidate, request, decision)
                return
            async for payload in self._planning.take(decision.plan):
                yield payload

    def _reject(
        self, candidate: Candidate, request: ev.ApprovalRequested, decision: Decision
    ) -> None:
        if candidate.examination.blocked:
            self._status, self._reason = "refused", "; ".join(request.blocked_by)
        elif request.blocked_by:
            self._status, self._reason = "held", "; ".join(request.blocked_by)
        else:
            self._status = "rejected"
            self._reason = decision.reason or f"rejected by {decision.by}"

    async def _carry_out(self, approved: Candidate) -> Payloads:
        async for payload in self.execution.run(approved.examination, approved.attempt):
            yield payload
        async for payload in self.execution.judge_outcome(approved.examination):
            yield payload
        verification = self.execution.verification
        if verification is not None:
            self._status = "verified" if verification.outcome == "pass" else "unverified"
            self._reason = verification.reason
