"""The run of one mission, from its words (step 2) to its report (step 10; paper, Section III).

A mission may take several plans: one for each phase of a workflow, and a new plan whenever a
premise of the running plan breaks. Each plan is made, checked, judged and approved on its own.
"""

import asyncio
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

from pa_console.language.canonical.reading import says_plainly
from pa_console.language.references.scene import Move
from pa_console.mission.context import Emit, MissionContext, MissionResult, Services, ordered_by
from pa_console.mission.decide import (
    ApprovedPlan,
    Decide,
    Readings,
    rejection,
)
from pa_console.mission.examine import Examination
from pa_console.mission.execute import ApprovedStep, Execution
from pa_console.mission.execution.dispatch import StepFeed
from pa_console.mission.judge import judge
from pa_console.mission.outcome import Results, WorkflowProgress, begun
from pa_console.mission.plan import (
    Candidate,
    PlanForDecision,
    PlanningFailure,
    plan,
    reexamine,
    take,
)
from pa_console.mission.planning.obstacles import unready_assets
from pa_console.mission.planning.propose import without_planner
from pa_console.mission.report import PlaceWatch, PlanFacts, ReportFacts, after_action_report
from pa_console.mission.retrieve import RetrievedRules, retrieve
from pa_console.mission.running.questions import OrderQuestions
from pa_console.mission.running.waiting import WaitingPlan, examined_again
from pa_console.mission.sequences.plan_patrol import plan_patrol
from pa_console.mission.sequences.plan_steps import Planned, plan_steps
from pa_console.mission.sequences.step_by_step import StepByStep
from pa_console.mission.understand import (
    NotUnderstood,
    RefusedMission,
    Understood,
)
from pa_console.mission.verify import OutcomeCase, OutcomeVerdicts, unjudged, verify
from pa_console.policy.moments import moment
from pa_console.policy.monitor import Monitor, halts
from pa_console.schema.command import DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Alarm, Mission
from pa_console.schema.rehearsal import Moment
from pa_console.schema.telemetry import Picture

MAX_VOIDED = 2
"""The number of plans, made void by changes of the situation, at which a mission is held."""
MAX_HALTS = 3
"""The largest number of halts after which a mission is still planned again."""
MAX_TRIES = 2
"""The number of plans that are executed for one task if none of them completes it."""
INTERRUPTED = "the mission was interrupted before its outcome could be judged"
READY_S = 90.0
"""The longest wait for assets that cannot start yet, in seconds. An autopilot takes half a minute
to start."""
WATCH_S = 12.0
"""The time for which the situation is watched after a plan, in seconds."""


@dataclass(frozen=True)
class StationSide:
    """The station's services for a mission.

    The services are a feed of the clock's steps with devices' replies, the operator's decisions,
    the queue of verdicts on outcomes, and the open alarms.
    """

    feed: StepFeed
    decide: Decide
    verdicts: OutcomeVerdicts
    open_alarms: Callable[[], Sequence[Alarm]]


class MissionRun:
    """One mission, from its words to its report.

    `work` may be called again after an emergency has preempted the mission. The mission then
    continues at the present phase of its workflow, with a new plan.
    """

    def __init__(
        self, services: Services, mission: Mission, emit: Emit, station: StationSide
    ) -> None:
        self._services, self._station, self._emit = services, station, emit
        self._monitor = Monitor(
            services.rulebook, services.fleet.world, services.sightings, services.pursuits
        )
        self._context = MissionContext(services, mission, emit, self._monitor)
        self._progress = WorkflowProgress(services.rulebook, mission)
        self._execution = Execution(self._context, station.feed)
        self._retrieved: RetrievedRules | None = None
        self._readings = Readings()
        self._waiting: WaitingPlan | None = None
        """The plan that was last proposed to the operator."""
        self._understood: Understood | None = None
        self._questions = OrderQuestions(self._context, station.decide)
        self._goes_on = asyncio.Event()
        self._goes_on.set()
        self._done = 0
        """The number of the order's steps that are done."""
        self._ordered: list[Move] = []
        """The moves that the mission's plans ordered, including a plan that was not approved."""
        self.moving = False
        """True while the mission waits for the fleet; the fleet must not wait for it then."""
        alarm = next((a for a in station.open_alarms() if a.id == mission.alarm), None)
        self._facts = ReportFacts(mission, alarm, warnings=services.rulebook.seal.warnings)
        self._results = Results(mission, self._progress, self._monitor, station.open_alarms)

    @property
    def mission(self) -> Mission:
        """The mission, with its text as it has been read so far."""
        return self._context.mission

    @property
    def subjects(self) -> frozenset[str]:
        """The subject of the mission, if it has one, and the tracks of its workflows."""
        own = (self.mission.subject,) if self.mission.subject is not None else ()
        return frozenset((*own, *self._progress.tracks))

    @property
    def in_steps(self) -> bool:
        """True if the mission is a patrol or another order in steps."""
        read = self._understood
        return read is not None and bool(read.steps or read.patrol)

    @property
    def proposes(self) -> bool:
        """True once the order is understood; False while the operator is asked what it means."""
        return self._understood is not None

    def pause(self, *, paused: bool, by: str) -> None:
        """Pause or resume the steps; raises ValueError if that changes nothing."""
        if paused != self._goes_on.is_set():
            is_so = "is paused already" if paused else "is not paused"
            raise ValueError(f"{self.mission.id} {is_so}")
        if paused:
            self._goes_on.clear()
        else:
            self._goes_on.set()
        self._emit(ev.StepsPaused(paused=paused, by=by))

    async def work(self) -> None:
        """Carry out the mission; a plan is executed only after an admissible approval."""
        seal = self._services.rulebook.seal
        self._emit(
            ev.MissionStarted(
                rules_content_sha256=seal.content_sha256, rules_warnings=seal.warnings
            )
        )
        outcome: MissionResult | NotUnderstood | None = self._all_done()
        while not isinstance(outcome, MissionResult):
            if outcome is not None or self._understood is None:
                understood = await self._questions.understand(outcome)
                if isinstance(understood, MissionResult):
                    outcome = understood
                else:
                    outcome = self._begin_as(understood)
            if outcome is None:
                await self._await_assets()
                if self._services.variant.workflows:
                    self._emit_workflow(self._progress.begin(self._now()))
                outcome = await self._plan_after_plan()
        self.close(outcome)

    def _all_done(self) -> MissionResult | None:
        """Return the result if the mission was preempted after its last step; None otherwise."""
        read = self._understood
        if read is None or not (read.steps or read.patrol):
            return None
        patrol = read.patrol
        count = len(patrol.places) * patrol.laps if patrol is not None else len(read.steps)
        return self._results.conclude() if self._done >= count else None

    async def _await_assets(self) -> None:
        """Wait, at most READY_S, until the assets that an operator's order needs can start.

        Other missions do not wait.
        """
        fleet = self._services.fleet
        end_s = fleet.time_s + READY_S
        if self.mission.source != "operator" or not (awaited := self._unready):
            return
        self._notice(f"waits for {', '.join(f'{n} (not ready: {w})' for n, w in awaited.items())}")
        self.moving = True
        try:
            with self._station.feed.follow() as steps:
                async for _ in steps:
                    if not self._unready or fleet.time_s >= end_s:
                        break
        finally:
            self.moving = False
        left = ", ".join(self._unready)
        self._notice(f"goes on without {left}: not ready in {READY_S:.0f} s" if left else "goes on")

    @property
    def _unready(self) -> dict[str, str]:
        """The assets that the order needs and that cannot start yet, with the reasons."""
        fleet = self._services.fleet
        return unready_assets(fleet.world, fleet.picture(), self.mission.text)

    def _notice(self, text: str) -> None:
        self._emit(ev.Noticed(level="info", subject=self.mission.id, text=text))

    def _begin_as(self, understood: Understood) -> None:
        """Continue with the mission as it was understood."""
        mission, self._understood = understood.mission, understood
        self._context.described = understood.described
        if understood.patrol is not None:
            self._facts.patrolled = {place: PlaceWatch() for place in understood.patrol.places}
        if mission == self._facts.mission:
            return
        self._emit(
            ev.OrderRead(
                text=mission.text,
                typed=mission.said,
                references=understood.references,
                follows=mission.follows,
            )
        )
        self._context.mission = mission
        self._progress = WorkflowProgress(self._services.rulebook, mission)
        self._facts.mission = mission
        self._results = Results(mission, self._progress, self._monitor, self._station.open_alarms)

    def close(self, outcome: MissionResult) -> None:
        """Emit the report and the end of the mission (step 10)."""
        facts, picture = self._facts, self._services.fleet.picture()
        status, reason = outcome.status, outcome.reason
        if (read := self._understood) is not None:
            past = self._services.past
            past.remember(self.mission, self._ordered, undid=read.undoes, corrects=read.corrects)
        text = after_action_report(facts, status, reason, picture, self._station.open_alarms())
        metrics = self._context.stopwatch.metrics(
            self._context.attempts, plans=facts.count, halts=len(facts.halts)
        )
        self._emit(ev.MissionReported(text=text))
        if read is not None:
            agents = {move.agent for move in self._ordered}
            if awaited := self._services.gate.manual.awaits(self.mission, status, agents):
                self._emit(ev.MissionAwaitsAssets(assets=awaited))
        self._emit(ev.MissionFinished(status=status, reason=reason, metrics=metrics))

    def see(self, picture: Picture) -> None:
        """Process new telemetry: monitor orderings and advance workflows."""
        self._facts.see(picture)
        if self._waiting is not None:
            self._waiting.see(picture)
        orders = self._execution.orders
        agents = tuple(order.agent for order in orders)
        now = moment(picture, self._services.fleet.world, orders, agents)
        halting = self._services.variant.checks
        for finding in self._monitor.observe(now):
            if halting and halts(finding, self._services.rulebook):
                self._execution.breach(f"{finding.rule_id}: {finding.message}")
        self._emit_workflow(self._progress.observe(now))

    def halt(self) -> tuple[DeviceCommand, ...]:
        """Halt the running plan; return the commands that bring its agents to a safe state."""
        return self._execution.halt()

    async def _plan_after_plan(self) -> MissionResult | NotUnderstood:
        """Run steps 3 to 9 for each plan that the mission takes; return its result."""
        task = self._progress.task or self.mission
        reasons: tuple[str, ...] = ()
        tries: dict[str, int] = {}
        while True:
            phase = self._progress.phase
            approved = await self._until_approved(self._retrieve(task), reasons)
            if isinstance(approved, NotUnderstood):
                return approved
            if isinstance(approved, MissionResult):
                return self._stopped_short(approved, phase, reasons)
            halted = await self._carry_out(approved, task, phase)
            if isinstance(halted, MissionResult):
                return halted
            if reasons := halted:
                if len(self._facts.halts) > MAX_HALTS:
                    return MissionResult("unverified", f"halted: {'; '.join(reasons)}")
                task = self._progress.task or task
                continue
            tries[task.text] = tries.get(task.text, 0) + 1
            following = self._progress.task or self._results.follow_up
            if following is None and self._services.variant.workflows:
                carried_out = approved.planned.best.examination.plan
                following = begun(carried_out, task, self._services.fleet.picture())
            if following is None or tries.get(following.text, 0) >= MAX_TRIES:
                return self._results.conclude()
            reasons, task = self._results.lacking(following, task), following

    def _retrieve(self, task: Mission) -> RetrievedRules:
        """Retrieve the rules (step 3); keep a reading that the operator chose for the same text."""
        before = self._retrieved
        chosen = before.chosen if before is not None and before.task.text == task.text else ""
        retrieved = retrieve(self._context, task, self._progress.verbs, chosen)
        self._retrieved, self._facts.rules = retrieved, retrieved.rule_ids
        return retrieved

    async def _until_approved(
        self, retrieved: RetrievedRules, reasons: Sequence[str]
    ) -> ApprovedPlan | MissionResult | NotUnderstood:
        """Plan, examine, judge and decide (steps 3 to 7) until a plan is approved or none can be.

        These steps are repeated if the operator gives a plan or chooses another reading, and if a
        change of the situation makes the plan void.
        """
        context, voided = self._context, 0
        proposed = self.mission.proposed if not self._facts.plans else None
        planned: Planned
        if proposed is None:
            planned = await self._planned(retrieved, reasons)
        else:
            unasked = without_planner(context, retrieved)
            planned = await take(context, unasked, proposed, author="agent")
        while isinstance(planned, PlanForDecision):
            verdict = planned.best.verdict
            judged = planned.steps or planned.by_grammar or verdict is not None
            planned = planned if judged else await judge(context, planned)
            if self.mission.standing and says_plainly(retrieved.task.text, planned.best.asked):
                planned = replace(planned, by_grammar=True)
            if (question := self._questions.left_by(planned, self._understood)) is not None:
                return question
            was_blocked = planned.best.examination.blocked
            self._waiting = waiting = WaitingPlan(context, retrieved.task, planned.best)
            decided = await waiting.decided(planned, self._readings, self._station.decide)
            planned = examined_again(planned, waiting.examination)
            shown = planned.best
            if isinstance(decided, Examination):
                fresh = decided
                if was_blocked or not fresh.blocked:
                    continue
            else:
                self._readings, decision = decided.readings, decided.decision
                if decision.kind == "choose":
                    self._retrieved = replace(planned.answered.retrieved, chosen=decision.asked)
                    planned = await plan(context, self._retrieved)
                    continue
                if decision.kind == "modify" and decision.plan is not None:
                    planned = await take(context, planned.answered, decision.plan)
                    continue
                if decision.kind != "approve":
                    if not self._facts.plans and not shown.examination.blocked:
                        self._remember(shown)
                    return rejection(shown, decided)
                fresh = await reexamine(context, retrieved.task, shown.examination.plan)
                if fresh is None:
                    why = self._services.gate.inadmissible(
                        decided.request, decision, self._services.rulebook
                    )
                    return MissionResult("held", why) if why else ApprovedPlan(planned, decided)
            changed = f"the situation changed: {'; '.join(fresh.broken)}"
            self._emit(ev.PlanVoided(attempt=shown.attempt, reason=changed))
            voided += 1
            if voided == MAX_VOIDED or proposed is not None:
                return MissionResult("held", changed)
            again, answer = planned.answered.retrieved, fresh.plan.answer
            planned = await self._planned(again, fresh.broken, answer)
        if isinstance(planned, PlanningFailure):
            return MissionResult("held", planned.error or "the planner gave no plan")
        if isinstance(planned, RefusedMission):
            return MissionResult("refused", planned.reason)
        return planned

    async def _planned(
        self, retrieved: RetrievedRules, reasons: Sequence[str], previous: str = ""
    ) -> Planned:
        """Return the plan for a task; for an order in steps, one plan for all remaining steps."""
        understood = self._understood
        if understood is not None and understood.patrol is not None:
            return await plan_patrol(self._context, retrieved, understood.patrol, self._done)
        if understood is None or not understood.steps:
            return await plan(self._context, retrieved, reasons, previous)
        left = understood.steps[self._done :]
        return await plan_steps(self._context, retrieved.task, left, self._questions.answers)

    def _stopped_short(
        self, stopped: MissionResult, phase: str, halted: Sequence[str]
    ) -> MissionResult:
        """Return the result of a mission whose next plan was not approved."""
        status, reason = stopped.status, stopped.reason
        if halted and self._facts.plans:
            why = f"{'; '.join(halted)}; the next plan was {status}: {reason}"
            return MissionResult("unverified", why)
        return MissionResult(status, f"phase {phase}: {reason}" if phase else reason)

    async def _carry_out(
        self, approved: ApprovedPlan, task: Mission, phase: str
    ) -> tuple[str, ...] | MissionResult:
        """Execute and verify one plan, watch its consequences, and request a verdict.

        These are steps 8 and 9. Returns the reasons for a halt; empty if the plan ran to its end.
        Returns the mission's result if a plan in steps was not completed. A plan that was
        interrupted is also reported.
        """
        decided, shown, services = approved.decided, approved.planned.best, self._services
        services.gate.grant(decided.request, decided.decision, services.rulebook)
        ordered = self._remember(shown)
        moved = {name for move in ordered for name in (move.agent, move.target, move.before)}
        services.standing.moves(self.mission.id, moved, ordered)
        plan_ = shown.examination.plan
        if len(plan_.steps) > 1:
            return await self._carry_out_steps(approved, task, phase)
        facts = PlanFacts(plan_, task.text, decision=decided.decision, unmet=shown.unmet)
        self.moving = True
        try:
            try:
                step = ApprovedStep.whole(shown.examination, decided.request)
                executed = await self._execution.run(step)
            except asyncio.CancelledError:
                self._facts.plans.append(replace(facts, halted=("interrupted before its end",)))
                raise
            facts.halted = executed.halted
            self._facts.plans.append(facts)
            if executed.halted:
                return executed.halted
            facts.verification = verification = verify(self._context, plan_, executed)
            self._results.verifications.append(verification)
            idle = shown.narrowed and all(action.verb == "hold" for action in plan_.actions)
            self._results.idle.append("; ".join(shown.unmet) if idle else "")
            if services.variant.workflows:
                await self._see_it_out(shown, phase, task)
        finally:
            self.moving = False
        if services.variant.judging:
            picture, selection = services.fleet.picture(), approved.planned.answered.selection
            feedback = shown.verdict.feedback if shown.verdict is not None else ""
            case = OutcomeCase(
                task, executed.before, picture, selection, plan_, verification, feedback
            )
            self._station.verdicts.ask(self._context, shown.attempt, case)
        return ()

    async def _carry_out_steps(
        self, approved: ApprovedPlan, task: Mission, phase: str
    ) -> tuple[str, ...] | MissionResult:
        """Execute and verify a plan in steps; return the mission's result if it was not completed.

        Each step is verified by itself. The judge is not asked about the outcome.
        """
        context, shown = self._context, approved.planned.best
        steps = StepByStep(
            context, self._execution, approved, task, self._results, self._facts, self._goes_on
        )
        self.moving = True
        try:
            if (ended := await steps.run()) is not None:
                return ended
            if self._services.variant.workflows:
                self._emit_workflow(self._progress.join(shown.examination.plan, self._now()))
                await self._watch_outcome(phase, task)
        finally:
            self._done += steps.orders_done
            self.moving = False
        return ()

    async def _see_it_out(self, shown: Candidate, phase: str, task: Mission) -> None:
        """Enter the workflow of an executed plan and watch its consequences.

        If the watch is interrupted, an event reports that there is no verdict on the outcome.
        """
        try:
            self._emit_workflow(self._progress.join(shown.examination.plan, self._now()))
            await self._watch_outcome(phase, task)
        except BaseException:
            if self._services.variant.judging:
                self._emit(unjudged(shown.attempt, INTERRUPTED))
            raise

    def _remember(self, shown: Candidate) -> tuple[Move, ...]:
        """Record and return a plan's moves, each with the asset's post before the plan."""
        ordered = ordered_by(shown.examination.plan, self._services.fleet.picture())
        self._ordered += ordered
        return ordered

    async def _watch_outcome(self, phase: str, task: Mission) -> None:
        """Wait until `phase` or `task` is over and has an outcome.

        The wait is at most WATCH_S simulated seconds.
        """
        fleet = self._services.fleet
        end_s = fleet.time_s + WATCH_S
        with self._station.feed.follow() as steps:
            async for _ in steps:
                if not self._results.awaits(phase, task) or fleet.time_s >= end_s:
                    return

    def _now(self) -> Moment:
        return moment(self._services.fleet.picture(), self._services.fleet.world, ())

    def _emit_workflow(self, moves: Iterable[ev.WorkflowMoved]) -> None:
        for move in moves:
            self._facts.moved(move, self._services.fleet.time_s)
            self._emit(move)
