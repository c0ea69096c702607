"""The in-process link between the orchestrator and the devices: delays and losses.

Messages to or from one device never overtake each other.
"""

from pa_console.schema.command import CommandReply, DeviceCommand
from pa_console.sim.state import Scene

DEGRADED_DELAY_S = (0.3, 1.2)
DEGRADED_LOSS = 0.3
"""Part of the telemetry reports that a degraded link loses; messages are only delayed."""


def send_command(scene: Scene, command: DeviceCommand, dt_s: float) -> None:
    """Put `command` on the link; it is due at the next step, later on a degraded link."""
    due = scene.tick + 1 + _delay(scene, command.agent, dt_s)
    due = max([due, *(t for t, _, c in scene.link.commands if c.agent == command.agent)])
    scene.link.sent += 1
    scene.link.commands = (*scene.link.commands, (due, scene.link.sent, command))


def send_reply(scene: Scene, reply: CommandReply, dt_s: float) -> None:
    """Put a device's `reply` on the link; a lost link loses it."""
    if comms_of(scene, reply.agent) == "lost":
        return
    due = scene.tick + _delay(scene, reply.agent, dt_s)
    due = max([due, *(t for t, _, r in scene.link.replies if r.agent == reply.agent)])
    scene.link.sent += 1
    scene.link.replies = (*scene.link.replies, (due, scene.link.sent, reply))


def take_commands(scene: Scene) -> list[DeviceCommand]:
    """Return the commands due now, in order of sending; those to a lost link are lost."""
    if not scene.link.commands:
        return []
    due = [entry for entry in scene.link.commands if entry[0] <= scene.tick]
    scene.link.commands = tuple(e for e in scene.link.commands if e[0] > scene.tick)
    return [command for _, _, command in due if comms_of(scene, command.agent) != "lost"]


def take_replies(scene: Scene) -> list[CommandReply]:
    """Return the replies due now, in order of sending."""
    if not scene.link.replies:
        return []
    due = [entry for entry in scene.link.replies if entry[0] <= scene.tick]
    scene.link.replies = tuple(e for e in scene.link.replies if e[0] > scene.tick)
    return [reply for _, _, reply in due]


def report_arrives(scene: Scene, agent: str) -> bool:
    """Return whether a telemetry report sent by `agent` now gets through."""
    comms = comms_of(scene, agent)
    return comms == "ok" or (comms == "degraded" and scene.rng.random() >= DEGRADED_LOSS)


def comms_of(scene: Scene, agent: str) -> str:
    """Return the state of the link to `agent`; one to an unknown agent ends at the gateway, ok."""
    asset = scene.assets.get(agent)
    return "ok" if asset is None else asset.comms


def _delay(scene: Scene, agent: str, dt_s: float) -> int:
    """Return the extra steps a message takes."""
    if comms_of(scene, agent) != "degraded":
        return 0
    return round(scene.rng.uniform(*DEGRADED_DELAY_S) / dt_s)
