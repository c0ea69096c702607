"""Commands that are carried out without a station, for the strict scorer."""

from collections.abc import Collection, Sequence

from pa_console.evaluation.score import (
    RunRecorder,
    Score,
    begin,
    is_decided,
    look,
    score_run,
    watch,
)
from pa_console.schema.command import FINAL_REPLIES, DeviceCommand
from pa_console.schema.evaluation import MissionCase
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint

LIMIT_S = 240.0
"""A stage of commands that has not ended by then is left behind."""

Stage = Sequence[DeviceCommand]


def rehearsed_run(
    case: MissionCase, world: World, seed: int, enforced: Collection[str], *stages: Stage
) -> Score:
    """Return what `case` scores when the commands of `stages` are sent, each after the last.

    No check is made: this tells whether a plan would be right.
    """
    sim = begin(case, world, seed)
    recorder = RunRecorder(sim, case.command)
    ended = [play(sim, recorder, stage) for stage in stages if stage]
    if not is_decided(case, recorder.recording):
        watch(sim, recorder, case.watch_s - recorder.recording.final.time_s)
    status = "refused" if not ended else "verified" if all(ended) else "unverified"
    return score_run(case, recorder, status, enforced)


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
        look(sim, recorder)
        if not waiting:
            break
    return done == len(commands)
