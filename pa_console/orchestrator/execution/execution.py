"""Step 7 of a mission: dispatch, follow to the end or halt, verify by telemetry, judge."""

from collections.abc import AsyncIterator, Iterator
from time import perf_counter

from pa_console.orchestrator.execution.dispatch import TIMED_OUT, Dispatch
from pa_console.orchestrator.execution.premises import Premises, safe_state
from pa_console.orchestrator.execution.step_feed import Step, StepFeed
from pa_console.orchestrator.execution.verification import needs_more_evidence, verify_plan
from pa_console.orchestrator.mission.services import Payloads, Services, Stopwatch
from pa_console.orchestrator.planning.judging import OutcomeCase, ask_about_outcome
from pa_console.orchestrator.planning.rehearsal import device_commands, order_moments
from pa_console.orchestrator.planning.safeguards import Examination
from pa_console.schema.command import DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Mission, Verification
from pa_console.schema.moment import OrderMoment
from pa_console.schema.plan import Action, Plan
from pa_console.schema.telemetry import Picture, Selection

MARGIN_S = 20.0
EVIDENCE_S = 8.0
"""How long fresh telemetry is waited for once every command has ended."""

SAFETY_S = 10.0
"""How long the commands of a safe state are followed and sent again."""

TOLD_S = 2.0
"""How long telemetry is waited for in which whoever was brought to a safe state is there."""


class Execution:
    """Carries out one approved plan after another; `verification` is of the last one."""

    def __init__(
        self, services: Services, mission: Mission, stopwatch: Stopwatch, feed: StepFeed
    ) -> None:
        self._services, self._mission, self._watch = services, mission, stopwatch
        self._feed = feed
        self._premises: Premises | None = None
        self._dispatch: Dispatch | None = None
        self._safety: tuple[Action, ...] = ()
        self._stopping: Dispatch | None = None
        self._halts = 0
        self.verification: Verification | None = None
        self.halted: tuple[str, ...] = ()
        """Why the last plan was halted; empty when it ran to its end."""
        self.breaches: list[str] = []
        """Orderings that were broken while the plan ran; whoever monitors them puts them here."""

    @property
    def under_way(self) -> tuple[str, ...]:
        """The agents that are still carrying out a command of the plan."""
        return self._dispatch.open_agents if self._dispatch is not None else ()

    @property
    def orders(self) -> tuple[OrderMoment, ...]:
        """The running plan's orders, for ordering rules."""
        if self._premises is None or self._dispatch is None:
            return ()
        done = {name for name, reply in self._dispatch.final.items() if reply.status == "done"}
        return order_moments(self._premises.plan, self._services.fleet.world, done)

    async def run(self, approved: Examination, request: ev.ApprovalRequested) -> Payloads:
        """Step 7: send every command, follow it to its end, then compare with telemetry.

        A broken premise or ordering halts the plan to the safe state that was approved with it in
        `request`; nothing is verified then. A plan whose approval cannot be logged is halted before
        anything is sent; one of which the gate keeps a command back is halted as well.
        """
        fleet, gate = self._services.fleet, self._services.gate
        timeline = approved.rehearsal.timeline if approved.rehearsal is not None else None
        premises = Premises(fleet.world, approved.plan, fleet.picture(), timeline)
        self._premises, self.verification, self.halted = premises, None, ()
        self.breaches.clear()
        if problem := self._services.journal.commit():
            gate.halt()
            self.halted = (problem,)
            yield ev.PlanHalted(attempt=request.attempt, reasons=self.halted)
            return
        limit_s = MARGIN_S + 2 * (timeline.duration_s if timeline is not None else 0.0)
        commands = device_commands(approved.plan, request.request_id)
        self._safety = request.if_halted
        start = fleet.time_s
        with self._feed.follow() as steps:
            self._dispatch = dispatch = Dispatch(commands, fleet.tick, fleet.world.dt_s, limit_s)
            with self._watch.time("dispatch_s"):
                for command in commands:
                    told = gate.send(command)
                    yield told
                    if isinstance(told, ev.CommandRefused):
                        self.halted = (f"{command.agent} {command.verb}: {told.reason}",)
                        break
            if not self.halted:
                async for payload in self._until_ended(premises, dispatch, steps):
                    yield payload
            if self.halted:
                async for payload in self._to_safety(request.attempt, steps):
                    yield payload
        self._dispatch = None
        gate.finish()
        self._watch.add("execution_s", fleet.time_s - start)
        if not self.halted:
            started = perf_counter()
            self.verification = verify_plan(
                approved.plan, fleet.world, premises.before, fleet.picture(), dispatch.final
            )
            seconds = perf_counter() - started
            yield ev.MissionVerified(verification=self.verification, seconds=seconds)

    async def judge_outcome(
        self, plan: Plan, mission: Mission, selection: Selection | None, said: str
    ) -> Payloads:
        """Step 7: the JudgeLLM says from telemetry whether `mission` was accomplished.

        `said` is what it said of the `plan`, '' when it was not asked.
        """
        if self.verification is None or self._premises is None:
            return
        fleet, before = self._services.fleet, self._premises.before
        case = OutcomeCase(
            mission, before, fleet.picture(), selection, plan, self.verification, said
        )
        asked = ask_about_outcome(self._services.dialect, fleet.world, case)
        with self._watch.time("outcome_s"):
            async for piece in asked.put_to(self._services.judge):
                if not isinstance(piece, str):
                    yield ev.OutcomeJudged(
                        verdict=piece.verdict, error=piece.error, usage=piece.usage
                    )

    def halt(self) -> tuple[DeviceCommand, ...]:
        """End the plan; return the commands that bring whoever is under way to a safe state.

        The caller sends them. Once everything is stopped there are none: every asset holds. Of a
        plan that was halted before, they are those that were not answered yet.
        """
        stopping, self._stopping = self._stopping, None
        under_way, self._dispatch = self.under_way, None
        self._services.gate.halt()
        if self._services.gate.stopped:
            return ()
        if stopping is not None:
            return stopping.open_commands
        if not under_way:
            return ()
        self._halts += 1
        prefix = f"{self._mission.id}.halt{self._halts}"
        return safe_state(self._safety, self._services.fleet.picture(), under_way, prefix)

    async def _until_ended(
        self, premises: Premises, dispatch: Dispatch, steps: AsyncIterator[Step]
    ) -> Payloads:
        """Follow the plan until there is evidence of how it ended, or `halted` says why not."""
        fleet = self._services.fleet
        seen: Picture | None = None
        ended_s: float | None = None
        async for step in steps:
            for payload in self._follow(dispatch, step):
                yield payload
            picture = fleet.picture()
            if picture is seen:
                continue
            seen = picture
            self.halted = tuple(gave_up(dispatch))
            if not dispatch.finished and self._services.variant.checks:
                broken = premises.broken(picture, dispatch.open_agents)
                self.halted = (*self.halted, *broken, *dict.fromkeys(self.breaches))
            if self.halted:
                return
            if not dispatch.finished:
                continue
            ended_s = fleet.time_s if ended_s is None else ended_s
            late = fleet.time_s - ended_s > EVIDENCE_S
            if late or not needs_more_evidence(premises.plan, picture, ended_s):
                return

    async def _to_safety(self, attempt: int, steps: AsyncIterator[Step]) -> Payloads:
        """Bring the agents under way to a safe state and follow them until telemetry shows it.

        The next plan is made from that picture: one from before has them still on their way.
        """
        fleet = self._services.fleet
        reasons = self.halted
        commands = self.halt()
        for command in commands:
            yield self._services.gate.send(command)
        yield ev.PlanHalted(
            attempt=attempt,
            reasons=reasons,
            safe_state=tuple(
                f"{c.agent} {c.verb}{f' {c.target}' if c.target else ''}" for c in commands
            ),
        )
        if not commands:
            return
        self._stopping = dispatch = Dispatch(commands, fleet.tick, fleet.world.dt_s, SAFETY_S)
        ended_s: float | None = None
        async for step in steps:
            for payload in self._follow(dispatch, step):
                yield payload
            if not dispatch.finished:
                continue
            ended_s = fleet.time_s if ended_s is None else ended_s
            assets = fleet.picture().assets
            told = all(assets[command.agent].stamp_s >= ended_s for command in commands)
            if told or fleet.time_s - ended_s > TOLD_S:
                break
        self._stopping = None

    def _follow(self, dispatch: Dispatch, step: Step) -> Iterator[ev.EventPayload]:
        """Take in one step's replies and send again what was not answered."""
        tick, replies = step
        for reply in dispatch.advance(tick, replies):
            yield ev.CommandReplied(reply=reply)
        for command, times in dispatch.resends(tick):
            resent = self._services.gate.resend(command, times)
            if resent is not None:
                yield resent


def gave_up(dispatch: Dispatch) -> Iterator[str]:
    """Yield what a device said that it cannot do; a device that says nothing is another matter."""
    for agent, reply in dispatch.final.items():
        if reply.status != "done" and not reply.detail.startswith(TIMED_OUT):
            yield f"{agent}: {reply.detail or reply.status}"
