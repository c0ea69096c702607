"""Follows the truth of a run from its command on, and scores it strictly (paper, Section V)."""

from collections.abc import Collection, Sequence

from pa_console.evaluation.scoring.oracle import find_breaches
from pa_console.evaluation.scoring.run_facts import RunFacts, gather
from pa_console.evaluation.scoring.run_recording import (
    AssetTruth,
    Breach,
    IssuedCommand,
    RunRecording,
    Sample,
)
from pa_console.evaluation.scoring.success_conditions import (
    compile_conditions,
    evaluate,
    is_decided,
)
from pa_console.schema.base import StrictModel
from pa_console.schema.command import FINAL_REPLIES, CommandReply, DeviceCommand
from pa_console.schema.evaluation import MissionCase
from pa_console.schema.events import event as ev
from pa_console.schema.mission import MissionStatus
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint


class RunRecorder:
    """Records `recording`, the truth of a run, from the session's events or without a station.

    It is created when the command is given: the truth of that moment is the run's start.
    """

    def __init__(self, sim: Checkpoint, command: str) -> None:
        self._sim, self._start_tick, self._start_s = sim, sim.tick, sim.time_s
        self._orders: dict[str, IssuedCommand] = {}
        self.recording = RunRecording(sim.world, command)
        self.sample()

    def see(self, event: ev.Event) -> None:
        """Take in one event of the session; telemetry is when the truth is looked at again."""
        match event.data:
            case ev.TelemetryReceived():
                self.sample()
            case ev.CommandSent(command=command) if event.tick >= self._start_tick:
                self._take(command, event.tick * self._sim.world.dt_s)
            case ev.CommandReplied(reply=reply):
                self.replied(reply)
            case _:
                pass

    def sample(self) -> None:
        """Take the truth as it is now; a second look at the same moment adds nothing."""
        time_s = round(self._sim.time_s - self._start_s, 6)
        if self.recording.samples and time_s <= self.recording.final.time_s:
            return
        self.recording.samples.append(_sample(self._sim, time_s))

    def sent(self, command: DeviceCommand) -> None:
        """Note that `command` goes out now."""
        self._take(command, self._sim.time_s)

    def replied(self, reply: CommandReply) -> None:
        """Note a device's answer; one to an order from before the run is none of its business."""
        order = self._orders.get(reply.command_id)
        if order is not None:
            order.done = order.done or reply.status == "done"
            order.rejected = order.rejected or reply.status == "refused"

    def finish(self, status: MissionStatus) -> RunFacts:
        """Return the run's facts with the mission's `status`; breaches are not yet among them."""
        self.sample()
        return gather(self.recording, status)

    def _take(self, command: DeviceCommand, time_s: float) -> None:
        """Keep an order once, however often it is sent again."""
        self.sample()
        if command.command_id in self._orders:
            return
        order = IssuedCommand(
            command_id=command.command_id,
            agent=command.agent,
            verb=command.verb,
            frame=command.target or "",
            sent_s=max(0.0, round(time_s - self._start_s, 6)),
        )
        self._orders[command.command_id] = order
        self.recording.orders.append(order)


def _sample(sim: Checkpoint, time_s: float) -> Sample:
    truth = sim.truth()
    assets = {
        name: AssetTruth(
            id=name,
            kind=asset.kind,
            position=asset.position,
            at=asset.at or "",
            post=asset.post or "",
            task=asset.task,
            status=asset.status,
            available=asset.available,
            battery_pct=asset.battery_pct,
            command_id=asset.command_id or "",
        )
        for name, asset in truth.assets.items()
    }
    return Sample(
        time_s=time_s,
        assets=assets,
        contacts={contact.id: contact for contact in sim.true_contacts()},
        cover={gate: cover.by for gate, cover in truth.gates.items()},
    )


class Score(StrictModel):
    """Strict success (paper, Section V-B) and what stands against it."""

    strict: bool
    failed: tuple[str, ...] = ()
    broken: tuple[Breach, ...] = ()


def score(case: MissionCase, facts: RunFacts, breaches: Sequence[Breach]) -> Score:
    """Judge the facts of a run of `case`; its conditions see the broken rules as `run.broken`."""
    ids = tuple(sorted({breach.rule_id for breach in breaches}))
    known = facts.model_copy(update={"broken": ids})
    failed = evaluate(compile_conditions(case.success), known)
    return Score(strict=not failed and not breaches, failed=failed, broken=tuple(breaches))


def score_run(
    case: MissionCase, recorder: RunRecorder, status: MissionStatus, enforced: Collection[str]
) -> Score:
    """Judge a finished run that `recorder` has followed; `enforced` are the rule ids in force."""
    facts = recorder.finish(status)
    return score(case, facts, find_breaches(recorder.recording, enforced))


SETTLE_S = 2.0
"""The time for the set-up to show before the command is given, seconds."""
LIMIT_S = 240.0
"""A stage of commands that has not ended by then is left behind."""

Stage = Sequence[DeviceCommand]


def idle_run(case: MissionCase, world: World, seed: int, enforced: Collection[str]) -> Score:
    """Return what `case` scores when nothing is ordered; raises ValueError for a bad set-up."""
    return rehearsed_run(case, world, seed, enforced, ())


def rehearsed_run(
    case: MissionCase,
    world: World,
    seed: int,
    enforced: Collection[str],
    commands: Stage,
    *,
    later: Sequence[Stage] = (),
) -> Score:
    """Return what `case` scores when `commands` are sent, and each stage of `later` after the last.

    No check is made: this tells whether a plan would be right. Raises ValueError for a set-up that
    the world does not take.
    """
    sim = begin(case, world, seed)
    recorder = RunRecorder(sim, case.command)
    ended = [play(sim, recorder, stage) for stage in (commands, *later) if stage]
    if not is_decided(case, recorder.recording):
        watch(sim, recorder, case.watch_s - recorder.recording.final.time_s)
    status = "refused" if not ended else "verified" if all(ended) else "unverified"
    return score_run(case, recorder, status, enforced)


def begin(case: MissionCase, world: World, seed: int) -> Checkpoint:
    """Return a fresh checkpoint with the set-up of `case`, as it is when the command is given."""
    sim = Checkpoint(world, seed)
    for incident in case.setup:
        sim.inject(incident)
    for _ in range(round(SETTLE_S / world.dt_s)):
        sim.step()
    return sim


def play(sim: Checkpoint, recorder: RunRecorder, commands: Stage) -> bool:
    """Send `commands`, follow them to their end; return whether every device has said done."""
    for command in commands:
        sim.send(command)
        recorder.sent(command)
    waiting = {command.command_id for command in commands}
    done = 0
    for _ in range(round(LIMIT_S / sim.world.dt_s)):
        for reply in sim.step():
            recorder.replied(reply)
            if reply.status in FINAL_REPLIES and reply.command_id in waiting:
                waiting.discard(reply.command_id)
                done += reply.status == "done"
        _look(sim, recorder)
        if not waiting:
            break
    return done == len(commands)


def watch(sim: Checkpoint, recorder: RunRecorder, seconds: float) -> None:
    """Let `seconds` of simulated time go by under the recorder's eyes."""
    for _ in range(round(max(0.0, seconds) / sim.world.dt_s)):
        for reply in sim.step():
            recorder.replied(reply)
        _look(sim, recorder)


def _look(sim: Checkpoint, recorder: RunRecorder) -> None:
    """Take the truth once a telemetry period."""
    if sim.tick % max(1, round(sim.world.telemetry_period_s / sim.world.dt_s)) == 0:
        recorder.sample()
