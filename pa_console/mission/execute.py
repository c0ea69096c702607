"""Step 8 of a mission: a plan from its dispatch to its end or halt, and the wait for evidence."""

from collections.abc import AsyncIterator, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Self

from pa_console.mission.context import MissionContext
from pa_console.mission.examine import Examination
from pa_console.mission.execution.dispatch import TIMED_OUT, Dispatch, Step, StepFeed
from pa_console.mission.execution.premises import Premises, safe_state
from pa_console.mission.rehearse import device_commands, order_moments
from pa_console.schema.command import ADDRESSING, CommandReply, DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import OrderMoment
from pa_console.schema.telemetry import AssetTelemetry, GateCover, Picture

MARGIN_S = 20.0
"""The time that a plan may take in addition to twice its rehearsed duration, in seconds."""
EPSILON_S = 1e-6
EVIDENCE_S = 8.0
"""The longest wait for fresh telemetry after every command has ended, in seconds."""

SAFETY_S = 10.0
"""The longest time for which the commands to a safe state are followed and resent, in seconds."""

TOLD_S = 2.0
"""The longest wait for telemetry that shows the assets in their safe state, in seconds."""


@dataclass(frozen=True)
class ExecutedPlan:
    """The result of an executed plan; `before` is the picture at its start."""

    before: Picture
    ended: Mapping[str, CommandReply] = field(default_factory=dict[str, CommandReply])
    """The last reply of each agent."""
    halted: tuple[str, ...] = ()
    """The reasons why the plan was halted; empty when it ran to its end."""


@dataclass(frozen=True)
class ApprovedStep:
    """The actions of an approved plan that are sent together; `numbers` are their numbers in it.

    `examination` covers only these actions; `goes_on` is True if other steps follow.
    """

    examination: Examination
    request: ev.ApprovalRequested
    numbers: tuple[int, ...]
    goes_on: bool = False

    @classmethod
    def whole(cls, examination: Examination, request: ev.ApprovalRequested) -> Self:
        """Return the whole plan of `request` as one step."""
        numbers = tuple(range(1, len(request.plan.actions) + 1))
        return cls(examination, request, numbers)

    @property
    def commands(self) -> tuple[DeviceCommand, ...]:
        """The commands of the step, with their ids from the approval request."""
        commands = device_commands(self.request.plan, self.request.request_id)
        return tuple(commands[number - 1] for number in self.numbers)

    @property
    def safety(self) -> tuple[Action, ...]:
        """The way to safety that was approved for these actions."""
        declared = self.request.if_halted
        if len(declared) != len(self.request.plan.actions):
            return declared
        return tuple(declared[number - 1] for number in self.numbers)


class Execution:
    """The execution of a mission's approved plans, one after another."""

    def __init__(self, context: MissionContext, feed: StepFeed) -> None:
        self._context, self._services, self._feed = context, context.services, feed
        self._premises: Premises | None = None
        self._dispatch: Dispatch | None = None
        self._safety: tuple[Action, ...] = ()
        self._stopping: Dispatch | None = None
        self._halts = 0
        self._breaches: list[str] = []

    @property
    def orders(self) -> tuple[OrderMoment, ...]:
        """The orders of the running plan, for ordering rules."""
        if self._premises is None or self._dispatch is None:
            return ()
        done = {name for name, reply in self._dispatch.final.items() if reply.status == "done"}
        return order_moments(self._premises.plan, self._services.fleet.world, done)

    def breach(self, broken: str) -> None:
        """Record an ordering that was broken while the plan ran; it halts the plan."""
        self._breaches.append(broken)

    async def run(self, step: ApprovedStep) -> ExecutedPlan:
        """Send every command of a step, and follow it until there is evidence of its outcome.

        If a premise or an ordering is broken, the plan is halted and the way to safety that was
        approved with it is sent. The plan is also halted if the gate refuses a command, or before
        any command is sent if the approval cannot be logged.
        """
        approved, request = step.examination, step.request
        fleet, gate, emit = self._services.fleet, self._services.gate, self._context.emit
        timeline = approved.rehearsal.timeline if approved.rehearsal is not None else None
        premises = Premises(fleet.world, approved.plan, fleet.picture(), timeline)
        self._premises = premises
        self._breaches.clear()
        if problem := self._services.journal.commit():
            gate.halt()
            emit(ev.PlanHalted(attempt=request.attempt, reasons=(problem,)))
            return ExecutedPlan(premises.before, halted=(problem,))
        limit_s = MARGIN_S + 2 * (timeline.duration_s if timeline is not None else 0.0)
        commands, self._safety = step.commands, step.safety
        start = fleet.time_s
        with self._feed.follow() as steps:
            self._dispatch = dispatch = Dispatch(commands, fleet.tick, fleet.world.dt_s, limit_s)
            with self._context.stopwatch.time("dispatch_s"):
                passages = gate.send(commands, emit)
            kept = (passage for passage in passages if isinstance(passage, ev.CommandRefused))
            refused = next((f"{k.command.agent} {k.command.verb}: {k.reason}" for k in kept), "")
            halted = (refused,) if refused else ()
            if not halted:
                halted = await self._until_ended(premises, dispatch, steps)
            if halted:
                await self._to_safety(request.attempt, halted, steps)
        self._dispatch = None
        if halted or not step.goes_on:
            gate.finish()
        self._context.stopwatch.add("execution_s", fleet.time_s - start)
        return ExecutedPlan(premises.before, dispatch.final, halted)

    async def stay(self, seconds: float) -> None:
        """Let `seconds` of the fleet's time pass between two steps."""
        fleet = self._services.fleet
        end_s = fleet.time_s + seconds
        with self._feed.follow() as steps:
            async for _ in steps:
                if fleet.time_s >= end_s - EPSILON_S:
                    break
        self._context.stopwatch.add("execution_s", seconds)

    def halt(self) -> tuple[DeviceCommand, ...]:
        """Halt the plan and return the commands that bring its moving assets to a safe state.

        The caller sends them. During a stop, no commands are returned, because every asset holds.
        If the plan was already halted, only the commands without a final reply are returned.
        """
        stopping, self._stopping = self._stopping, None
        under_way = self._dispatch.open_agents if self._dispatch is not None else ()
        self._dispatch = None
        self._services.gate.halt()
        if self._services.gate.stopped:
            return ()
        if stopping is not None:
            return stopping.open_commands
        if not under_way:
            return ()
        self._halts += 1
        prefix = f"{self._context.mission.id}.halt{self._halts}"
        return safe_state(self._safety, self._services.fleet.picture(), under_way, prefix)

    async def _until_ended(
        self, premises: Premises, dispatch: Dispatch, steps: AsyncIterator[Step]
    ) -> tuple[str, ...]:
        """Follow the plan until there is evidence of its outcome; return the reasons for a halt."""
        fleet = self._services.fleet
        seen: Picture | None = None
        ended_s: float | None = None
        async for step in steps:
            self._follow(dispatch, step)
            picture = fleet.picture()
            if picture is seen:
                continue
            seen = picture
            halted = tuple(gave_up(dispatch))
            if not dispatch.finished and self._services.variant.checks:
                broken = premises.broken(picture, dispatch.open_agents)
                halted = (*halted, *broken, *dict.fromkeys(self._breaches))
            if halted:
                return halted
            if not dispatch.finished:
                continue
            ended_s = fleet.time_s if ended_s is None else ended_s
            late = fleet.time_s - ended_s > EVIDENCE_S
            if late or not needs_more_evidence(premises.plan, picture, ended_s):
                break
        return ()

    async def _to_safety(
        self, attempt: int, reasons: tuple[str, ...], steps: AsyncIterator[Step]
    ) -> None:
        """Bring the agents under way to a safe state, and wait until telemetry shows them there.

        The next plan is made from that picture, because an earlier picture would still show the
        agents on their way.
        """
        fleet = self._services.fleet
        commands = self.halt()
        self._services.gate.send(commands, self._context.emit)
        self._context.emit(
            ev.PlanHalted(
                attempt=attempt,
                reasons=reasons,
                safe_state=tuple(
                    f"{c.agent} {c.verb}{f' {c.target}' if c.target else ''}" for c in commands
                ),
            )
        )
        if not commands:
            return
        self._stopping = dispatch = Dispatch(commands, fleet.tick, fleet.world.dt_s, SAFETY_S)
        ended_s: float | None = None
        async for step in steps:
            self._follow(dispatch, step)
            if not dispatch.finished:
                continue
            ended_s = fleet.time_s if ended_s is None else ended_s
            assets = fleet.picture().assets
            reported = all(assets[command.agent].stamp_s >= ended_s for command in commands)
            if reported or fleet.time_s - ended_s > TOLD_S:
                break
        self._stopping = None

    def _follow(self, dispatch: Dispatch, step: Step) -> None:
        """Process the replies of one step and resend unanswered commands."""
        tick, replies = step
        for reply in dispatch.advance(tick, replies):
            self._context.emit(ev.CommandReplied(reply=reply))
        for command, times in dispatch.resends(tick):
            resent = self._services.gate.resend(command, times)
            if resent is not None:
                self._context.emit(resent)


def gave_up(dispatch: Dispatch) -> Iterator[str]:
    """Yield the refusals and failures that devices report; time-outs are not included."""
    for agent, reply in dispatch.final.items():
        if reply.status != "done" and not reply.detail.startswith(TIMED_OUT):
            yield f"{agent}: {reply.detail or reply.status}"


def needs_more_evidence(plan: Plan, picture: Picture, since_s: float) -> bool:
    """Return whether a required report from `since_s` or later is still missing.

    No report is expected from an asset that is known to have failed.
    """
    agents = {action.agent for action in plan.actions}
    for cover in picture.gates.values():
        if cover.unknown or (cover.covered and cover_stamp(cover, picture) < since_s - EPSILON_S):
            return True
    for agent in agents:
        asset = picture.assets.get(agent)
        if asset is not None and asset.status != "failed" and doubt_of(asset, picture, since_s):
            return True
    return any(
        track.stale or track.stamp_s < since_s - EPSILON_S
        for action in plan.actions
        if action.verb in ADDRESSING
        for track in picture.tracks.values()
        if track.gate == action.target
    )


def cover_stamp(cover: GateCover, picture: Picture) -> float:
    """Return the time of the latest report of an asset that covers the gate; 0 without one."""
    stamps = (picture.assets[name].stamp_s for name in cover.by if name in picture.assets)
    return max(stamps, default=0.0)


def doubt_of(asset: AssetTelemetry, picture: Picture, end_s: float) -> str:
    """Return why the asset's latest report is no evidence; '' if it is evidence."""
    age = picture.time_s - asset.stamp_s
    if asset.integrity == "suspect":
        return "its telemetry is suspect"
    if asset.comms == "lost":
        return f"it has been silent for {age:.0f} s"
    if asset.stale:
        return f"the last telemetry is {age:.0f} s old"
    if asset.stamp_s < end_s - EPSILON_S:
        return f"no telemetry since its command ended, {picture.time_s - end_s:.0f} s ago"
    return ""
