"""Runs without any station: nothing ordered at all, or a given plan carried out as it stands."""

from collections.abc import Collection, Sequence

from pa_console.evaluation.scoring.score import RunRecorder, Score, score_run
from pa_console.evaluation.scoring.success_conditions import is_decided
from pa_console.schema.command import FINAL_REPLIES, DeviceCommand
from pa_console.schema.evaluation import MissionCase
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint

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
