"""The eight steps for one mission, as a stream of event payloads (paper, Section III).

A mission may take several plans: one for each phase of a workflow, and another one whenever a
premise of the running plan breaks. Each is planned, checked, judged and approved on its own.
"""

import asyncio
from collections.abc import Callable, Iterator, Sequence
from time import perf_counter

from pa_console.orchestrator.execution.execution import Execution
from pa_console.orchestrator.execution.results import Results, begun
from pa_console.orchestrator.execution.step_feed import StepFeed
from pa_console.orchestrator.mission.report import ReportFacts, after_action_report
from pa_console.orchestrator.mission.services import Payloads, Services, Stopwatch
from pa_console.orchestrator.mission.workflow_progress import WorkflowProgress
from pa_console.orchestrator.planning.candidate import Candidate
from pa_console.orchestrator.planning.decision import Decide, Deciding
from pa_console.orchestrator.planning.planning import Planning
from pa_console.policy.checks.rule_checks import check_mission
from pa_console.policy.ordering.moments import moment
from pa_console.policy.ordering.monitor import Monitor, halts
from pa_console.schema.alarm import Alarm
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Mission, MissionStatus
from pa_console.schema.moment import Moment
from pa_console.schema.telemetry import Picture

MAX_VOIDED = 2
MAX_HALTS = 3
MAX_TRIES = 2
"""Plans that may be executed for one task without bringing it to its end."""

WATCH_S = 12.0
"""How long the situation is watched after a plan for what it led to."""


class MissionRun:
    """Works on one mission from retrieval to report; the caller logs and shows what it yields.

    `payloads` may be asked for again after the mission had to give way to an emergency: it goes
    on where the workflow stands, with a new plan.
    """

    def __init__(
        self,
        services: Services,
        mission: Mission,
        feed: StepFeed,
        decide: Decide,
        open_alarms: Callable[[], Sequence[Alarm]],
    ) -> None:
        """`decide` is awaited for the operator's answer once approval was requested."""
        self.mission = mission
        self._services, self._feed, self._open_alarms = services, feed, open_alarms
        self._watch = Stopwatch()
        self._monitor = Monitor(services.rulebook, services.fleet.world, services.sightings)
        self._planning = Planning(services, mission, self._watch, self._monitor)
        self._deciding = Deciding(
            self._planning,
            mission,
            services.fleet.world,
            decide,
            self._watch,
            judging=services.variant.judging,
            readings=services.variant.readings,
        )
        self._course = WorkflowProgress(services.rulebook, mission)
        self.execution = Execution(services, mission, self._watch, feed)
        self.moving = False
        """Whether the mission waits for the world, not the world for the mission."""
        self._status: MissionStatus = "held"
        self._reason = ""
        alarm = next((a for a in open_alarms() if a.id == mission.alarm), None)
        self._facts = ReportFacts(mission, alarm, warnings=services.rulebook.seal.warnings)
        self._results = Results(mission, self._course, self._monitor, open_alarms)

    @property
    def subjects(self) -> frozenset[str]:
        """What the mission deals with: its own subject and the tracks of its workflows."""
        own = (self.mission.subject,) if self.mission.subject is not None else ()
        return frozenset((*own, *self._course.tracks))

    async def payloads(self) -> Payloads:
        """Yield everything that happens; a plan is executed only after an admissible approval."""
        seal = self._services.rulebook.seal
        yield ev.MissionStarted(
            rules_content_sha256=seal.content_sha256, rules_warnings=seal.warnings
        )
        refused = await self._refused_at_intake()
        if refused is not None:
            yield refused
        else:
            if self._services.variant.workflows:
                for move in self._course.begin(self._now()):
                    yield self._note(move)
            async for payload in self._plan_after_plan():
                yield payload
        for payload in self.close(self._status, self._reason):
            yield payload

    def close(
        self, status: MissionStatus, reason: str
    ) -> tuple[ev.MissionReported, ev.MissionFinished]:
        """Return the report and the end of the mission."""
        facts, picture = self._facts, self._services.fleet.picture()
        text = after_action_report(facts, status, reason, picture, self._open_alarms())
        plans, stops = len(facts.plans), len(facts.halts)
        metrics = self._watch.metrics(self._planning.attempts, plans=plans, halts=stops)
        finished = ev.MissionFinished(status=status, reason=reason, metrics=metrics)
        return ev.MissionReported(text=text), finished

    def see(self, picture: Picture) -> Iterator[ev.WorkflowMoved]:
        """Take in new telemetry: orderings are monitored, workflows move on."""
        self._facts.see(picture)
        orders = self.execution.orders
        agents = tuple(order.agent for order in orders)
        now = moment(picture, self._services.fleet.world, orders, agents)
        halting = self._services.variant.checks
        for finding in self._monitor.observe(now):
            if halting and halts(finding, self._services.rulebook):
                self.execution.breaches.append(f"{finding.rule_id}: {finding.message}")
        for move in self._course.observe(now):
            yield self._note(move)

    async def _plan_after_plan(self) -> Payloads:
        """Steps 2 to 8, once for every plan that the mission takes."""
        task = self._course.task or self.mission
        reasons: tuple[str, ...] = ()
        tries: dict[str, int] = {}
        while True:
            phase = self._course.phase
            async for payload in self._planning.retrieve(task, self._course.verbs):
                yield payload
            self._facts.rules = self._planning.rule_ids
            async for payload in self._until_approved(reasons):
                yield payload
            approved, request = self._deciding.approved, self._deciding.request
            decision = self._deciding.decision
            if approved is None or request is None or decision is None:
                self._stop_short(phase, reasons)
                return
            self._services.gate.grant(request, decision)
            self._facts.decided(decision, approved.unmet)
            async for payload in self._carry_out(approved, request, task):
                yield payload
            reasons = self.execution.halted
            if reasons:
                if len(self._facts.halts) > MAX_HALTS:
                    self._status, self._reason = "unverified", f"halted: {'; '.join(reasons)}"
                    return
                task = self._course.task or task
                continue
            tries[task.text] = tries.get(task.text, 0) + 1
            following = self._course.task or self._results.follow_up
            if following is None and self._services.variant.workflows:
                following = begun(approved.examination.plan, task, self._services.fleet.picture())
            if following is None or tries.get(following.text, 0) >= MAX_TRIES:
                self._status, self._reason = self._results.conclude()
                return
            reasons, task = self._results.lacking(following, task), following

    def _stop_short(self, phase: str, halted: Sequence[str]) -> None:
        """Say what a mission comes to whose next plan was not approved."""
        status, reason = self._deciding.status, self._deciding.reason
        self._status, self._reason = status, f"phase {phase}: {reason}" if phase else reason
        if halted and self._facts.plans:
            why = f"{'; '.join(halted)}; the next plan was {status}: {reason}"
            self._status, self._reason = "unverified", why

    async def _until_approved(self, reasons: Sequence[str]) -> Payloads:
        """Steps 3 to 6: plan and decide, and again if the situation changed meanwhile."""
        previous = ""
        for _ in range(MAX_VOIDED):
            async for payload in self._planning.propose(reasons, previous):
                yield payload
            async for payload in self._deciding.settle():
                yield payload
            candidate = self._deciding.approved
            if candidate is None:
                return
            fresh = await self._planning.reexamine()
            if fresh is None:
                return
            reason = f"the situation changed: {'; '.join(fresh.broken)}"
            self._deciding.approved = None
            self._deciding.status, self._deciding.reason = "held", reason
            yield ev.PlanVoided(attempt=candidate.attempt, reason=reason)
            reasons, previous = fresh.broken, fresh.plan.answer

    async def _refused_at_intake(self) -> ev.PlanChecked | None:
        """Decide the rules that concern the mission's words alone, before any model is asked."""
        services = self._services
        if not services.variant.checks:
            return None
        started = perf_counter()
        findings = await asyncio.to_thread(
            check_mission, services.rulebook, self.mission, services.fleet.world
        )
        seconds = perf_counter() - started
        self._watch.add("checks_s", seconds)
        blocking = [f"{f.rule_id}: {f.message}" for f in findings if f.blocking]
        if not blocking:
            return None
        self._status, self._reason = "refused", "; ".join(blocking)
        return ev.PlanChecked(attempt=1, findings=findings, seconds=seconds)

    async def _carry_out(
        self, approved: Candidate, request: ev.ApprovalRequested, task: Mission
    ) -> Payloads:
        """Step 7 and 8 for one plan: execute, see what comes of it, judge the outcome."""
        phase = self._course.phase
        self.moving = True
        try:
            async for payload in self._execute(approved, request, task):
                yield payload
            if self.execution.verification is None:
                return
            if self._services.variant.workflows:
                for move in self._course.join(approved.examination.plan, self._now()):
                    yield self._note(move)
                await self._watch_outcome(phase, task)
        finally:
            self.moving = False
        if self._services.variant.judging:
            said = approved.verdict.feedback if approved.verdict is not None else ""
            async for payload in self.execution.judge_outcome(
                approved.examination.plan, task, self._planning.selection, said
            ):
                if isinstance(payload, ev.OutcomeJudged):
                    self._facts.judged(payload.verdict)
                yield payload

    async def _execute(
        self, approved: Candidate, request: ev.ApprovalRequested, task: Mission
    ) -> Payloads:
        """Execute a plan and note for the report what became of it, also when it is cut short."""
        plan = approved.examination.plan
        try:
            async for payload in self.execution.run(approved.examination, request):
                yield payload
        except asyncio.CancelledError:
            self._facts.executed(plan, task, None, ("interrupted before its end",))
            raise
        verification = self.execution.verification
        self._facts.executed(plan, task, verification, self.execution.halted)
        if verification is not None:
            self._results.verifications.append(verification)

    async def _watch_outcome(self, phase: str, task: Mission) -> None:
        """Let the world go on until `phase` or `task` is over and its outcome known.

        At most WATCH_S simulated seconds.
        """
        fleet = self._services.fleet
        end_s = fleet.time_s + WATCH_S
        with self._feed.follow() as steps:
            async for _ in steps:
                if not self._results.awaits(phase, task) or fleet.time_s >= end_s:
                    return

    def _now(self) -> Moment:
        return moment(self._services.fleet.picture(), self._services.fleet.world, ())

    def _note(self, move: ev.WorkflowMoved) -> ev.WorkflowMoved:
        self._facts.moved(move, self._services.fleet.time_s)
        return move
