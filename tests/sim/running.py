"""Sends commands and collects answers, for tests of the simulation."""

from pa_console.schema.command import FINAL_REPLIES, CommandReply, DeviceCommand, Verb
from pa_console.sim.checkpoint import Checkpoint


def order(
    sim: Checkpoint, agent: str, verb: Verb, target: str | None = None, command_id: str = ""
) -> str:
    """Send one command; return its id."""
    command_id = command_id or f"{agent}.{verb}.{sim.tick}"
    sim.send(DeviceCommand(command_id=command_id, agent=agent, verb=verb, target=target))
    return command_id


def run(sim: Checkpoint, seconds: float) -> list[CommandReply]:
    """Step for `seconds`; return every reply."""
    return [reply for _ in range(round(seconds / sim.world.dt_s)) for reply in sim.step()]


def finish(sim: Checkpoint, command_id: str, limit_s: float = 120.0) -> list[CommandReply]:
    """Step until the command has ended; return its replies. Fails after `limit_s`."""
    replies: list[CommandReply] = []
    for _ in range(round(limit_s / sim.world.dt_s)):
        replies += [reply for reply in sim.step() if reply.command_id == command_id]
        if replies and replies[-1].status in FINAL_REPLIES:
            return replies
    raise AssertionError(f"{command_id} did not end within {limit_s} s: {replies}")


def carry_out(
    sim: Checkpoint, agent: str, verb: Verb, target: str | None = None
) -> list[CommandReply]:
    """Send one command, step until it has ended and until telemetry shows it."""
    replies = finish(sim, order(sim, agent, verb, target))
    run(sim, sim.world.telemetry_period_s)
    return replies
