"""Carries a mission through its workflow without any model: what comes after the first plan.

Later phases are planned by a rule: the first free asset of the right kind that the safeguards let
go. Halts, phases and waiting are those of a mission at the console (WF-01).
"""

import asyncio
from collections.abc import Iterator
from dataclasses import dataclass, field

from pa_console.evaluation.score import RunRecorder
from pa_console.mission.examine import Examination, examine
from pa_console.mission.execute import EVIDENCE_S, MARGIN_S, SAFETY_S, gave_up, needs_more_evidence
from pa_console.mission.execution.dispatch import Dispatch
from pa_console.mission.execution.premises import Premises, safe_state, way_to_safety
from pa_console.mission.outcome import WorkflowProgress
from pa_console.mission.planning.picture_text import digest_picture
from pa_console.mission.rehearse import order_moments
from pa_console.mission.run import MAX_HALTS, MAX_TRIES, WATCH_S
from pa_console.mission.verify import verify_plan
from pa_console.policy.moments import moment
from pa_console.policy.monitor import Monitor
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.command import COMMANDS
from pa_console.schema.mission import Mission, Verification
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import OrderMoment
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import KINDS
from pa_console.sim.checkpoint import Checkpoint
from pa_training.proof.playing import carry_out, telemetry_ticks


@dataclass(frozen=True)
class CarriedOut:
    """One plan that was carried out for `task`, and what telemetry shows of it afterwards.

    There is no verification of a plan that was `halted`. `picture` is what the station knows when
    the outcome is judged.
    """

    task: Mission
    plan: Plan
    halted: tuple[str, ...]
    verification: Verification | None
    picture: Picture


@dataclass
class Follower:
    """One mission in a checkpoint that is stepped; `done` is what was carried out, in order."""

    sim: Checkpoint
    mission: Mission
    rulebook: Rulebook
    recorder: RunRecorder
    done: list[CarriedOut] = field(default_factory=list[CarriedOut])

    def __post_init__(self) -> None:
        """Begin with no history of orderings and phases."""
        self._course = WorkflowProgress(self.rulebook, self.mission)
        self._monitor = Monitor(self.rulebook, self.sim.world)
        self._breaches: list[str] = []

    @property
    def verified(self) -> bool:
        """Whether everything that was carried out, and its workflow, came to a good end."""
        passed = all(d.verification is None or d.verification.outcome == "pass" for d in self.done)
        ended = bool(self.done) and not self.done[-1].halted
        return passed and ended and self._course.over and self._course.settled

    def run(self, first: Examination, *, follow: bool) -> None:
        """Carry out the plan of `first`, which nothing blocks, then the phases if `follow`.

        A halted plan is tried again as long as the safeguards admit it.
        """
        found: Examination | None = first
        tries: dict[str, int] = {}
        halts = 0
        while found is not None:
            task, phase = self._course.task or self.mission, self._course.phase
            if self._execute(found, task, phase, follow=follow):
                tries[task.text] = tries.get(task.text, 0) + 1
                following = self._course.task if follow else None
                if following is None or tries.get(following.text, 0) >= MAX_TRIES:
                    return
            else:
                halts += 1
                if halts > MAX_HALTS or not follow:
                    return
            found = self._next(found.plan)

    def _execute(self, found: Examination, task: Mission, phase: str, *, follow: bool) -> bool:
        """Carry one plan out; False when it was halted."""
        sim, plan, number = self.sim, found.plan, len(self.done)
        timeline = found.rehearsal.timeline if found.rehearsal is not None else None
        limit_s = MARGIN_S + 2 * (timeline.duration_s if timeline is not None else 0.0)
        premises = Premises(sim.world, plan, sim.picture(), timeline)
        halted: list[str] = []

        def look(dispatch: Dispatch) -> bool:
            self._see(plan, dispatch)
            halted.extend(gave_up(dispatch))
            if not dispatch.finished:
                halted.extend(premises.broken(sim.picture(), dispatch.open_agents))
                halted.extend(dict.fromkeys(self._breaches))
            return not halted

        self._breaches.clear()
        dispatch = carry_out(sim, self.recorder, plan, f"M.{number}", limit_s, look)
        if not halted:
            halted.extend(self._wait_for_evidence(plan, dispatch))
        if halted:
            self._to_safety(premises, dispatch, f"M.halt{number}")
            self.done.append(CarriedOut(task, plan, tuple(halted), None, sim.picture()))
            return False
        verification = verify_plan(plan, sim.world, premises.before, sim.picture(), dispatch.final)
        if follow:
            for _ in self._course.join(plan, moment(sim.picture(), sim.world, ())):
                pass
            self._wait(phase)
        self.done.append(CarriedOut(task, plan, (), verification, sim.picture()))
        return True

    def _wait_for_evidence(self, plan: Plan, dispatch: Dispatch) -> tuple[str, ...]:
        """Let pictures arrive until they show how the plan has ended, at most EVIDENCE_S.

        Return what the devices said that they could not do, which halts the plan too.
        """
        ended_s: float | None = None
        while True:
            self._step(plan, dispatch)
            if self.sim.tick % telemetry_ticks(self.sim) == 0:
                if unable := tuple(gave_up(dispatch)):
                    return unable
                ended_s = self.sim.time_s if ended_s is None else ended_s
                late = self.sim.time_s - ended_s > EVIDENCE_S
                if late or not needs_more_evidence(plan, self.sim.picture(), ended_s):
                    return ()

    def _wait(self, phase: str) -> None:
        """Let the world go on until `phase` is over and its outcome known, at most WATCH_S."""
        end_s = self.sim.time_s + WATCH_S
        while (phase and self._course.phase == phase) or not self._course.settled:
            if self.sim.time_s >= end_s:
                return
            self._step()

    def _next(self, last: Plan) -> Examination | None:
        """Return the next plan that nothing blocks, None when there is none."""
        task = self._course.task
        plans = [last] if task is None else self._phase_plans(task)
        for plan in plans:
            found = self._examined(plan, task or self.mission)
            if not found.blocked:
                return found
        return None

    def _phase_plans(self, task: Mission) -> Iterator[Plan]:
        """Yield the ways to carry out a phase: those at its gate first, then the free ones."""
        picture, gate = self.sim.picture(), task.gate or ""
        free = digest_picture(picture, self.sim.world).free
        for verb in self._course.verbs:
            for kind in KINDS:
                if kind not in COMMANDS[verb].kinds:
                    continue
                here = [
                    name
                    for name, asset in picture.assets.items()
                    if asset.kind == kind and asset.at == gate == asset.post and asset.available
                ]
                for name in dict.fromkeys((*here, *free[kind])):
                    action = Action(agent=name, command=f"{verb} {gate}")
                    yield Plan(reason=f"phase {self._course.phase}", actions=(action,))

    def _examined(self, plan: Plan, task: Mission) -> Examination:
        return asyncio.run(examine(plan, task, self.sim, self.rulebook, self._monitor))

    def _to_safety(self, premises: Premises, dispatch: Dispatch, prefix: str) -> None:
        """Bring whoever is under way to a safe state."""
        sim = self.sim
        declared = way_to_safety(premises.plan, premises.world, premises.before)
        commands = safe_state(declared, sim.picture(), dispatch.open_agents, prefix)
        follow = Dispatch(commands, sim.tick, sim.world.dt_s, SAFETY_S)
        for command in commands:
            self.recorder.sent(command)
            sim.send(command)
        while not follow.finished:
            self._step(None, follow)
            for command, _ in follow.resends(sim.tick):
                sim.send(command)

    def _step(self, plan: Plan | None = None, dispatch: Dispatch | None = None) -> None:
        """Let one step go by, under the eyes of recorder, orderings and workflow."""
        replies = self.sim.step()
        for reply in replies if dispatch is None else dispatch.advance(self.sim.tick, replies):
            self.recorder.replied(reply)
        if self.sim.tick % telemetry_ticks(self.sim) == 0:
            self.recorder.sample()
            self._see(plan, dispatch)

    def _see(self, plan: Plan | None, dispatch: Dispatch | None) -> None:
        """Take in a new picture: orderings are monitored, workflows move on."""
        world = self.sim.world
        orders: tuple[OrderMoment, ...] = ()
        if plan is not None and dispatch is not None:
            done = {name for name, reply in dispatch.final.items() if reply.status == "done"}
            orders = order_moments(plan, world, done)
        now = moment(self.sim.picture(), world, orders, [order.agent for order in orders])
        for finding in self._monitor.observe(now):
            each = {order.each for order in self.rulebook.get(finding.rule_id).order}
            if finding.blocking and each != {"gate"}:
                self._breaches.append(f"{finding.rule_id}: {finding.message}")
        for _ in self._course.observe(now):
            pass
