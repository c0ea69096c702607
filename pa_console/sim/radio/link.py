"""Messages between the station and the devices, under way over the radio.

Commands and replies of one device never overtake each other. A command is lost if its device's
link does not work when it would arrive, a reply or report if it does not when it is sent.
"""

from pa_console.schema.command import CommandReply, DeviceCommand
from pa_console.sim.radio import radio
from pa_console.sim.state.link_state import Report
from pa_console.sim.state.scene import Scene


def send_command(scene: Scene, command: DeviceCommand, dt_s: float) -> None:
    """Put `command` on the link; it is due at the next step at the earliest.

    One to an unknown agent ends at the gateway, which is wired.
    """
    asset = scene.assets.get(command.agent)
    if asset is not None and radio.loses(scene, asset):
        return
    steps = 1 if asset is None else radio.delay(scene, asset, dt_s)
    due = _in_order(scene, "to", command.agent, scene.tick + steps)
    scene.link.commands = (*scene.link.commands, (due, scene.link.sent, command))


def send_reply(scene: Scene, reply: CommandReply, dt_s: float) -> None:
    """Put a device's `reply` on the link; the gateway's own replies come at the next step."""
    asset = scene.assets.get(reply.agent)
    if asset is not None and (not radio.works(scene, asset) or radio.loses(scene, asset)):
        return
    steps = 1 if asset is None else radio.delay(scene, asset, dt_s)
    due = _in_order(scene, "from", reply.agent, scene.tick + steps)
    scene.link.replies = (*scene.link.replies, (due, scene.link.sent, reply))


def send_report(scene: Scene, report: Report, dt_s: float) -> None:
    """Put a report that its asset's link has not lost on its way; a later one may overtake it."""
    due = scene.tick + radio.delay(scene, scene.assets[report.agent], dt_s)
    scene.link.reports.setdefault(due, []).append(report)


def take_commands(scene: Scene) -> list[DeviceCommand]:
    """Return the commands that arrive now, in order of sending."""
    if not scene.link.commands:
        return []
    due = [entry for entry in scene.link.commands if entry[0] <= scene.tick]
    if due:
        scene.link.commands = tuple(e for e in scene.link.commands if e[0] > scene.tick)
    return [command for _, _, command in due if _reaches(scene, command.agent)]


def take_replies(scene: Scene) -> list[CommandReply]:
    """Return the replies that arrive now, in order of sending."""
    if not scene.link.replies:
        return []
    due = [entry for entry in scene.link.replies if entry[0] <= scene.tick]
    if due:
        scene.link.replies = tuple(e for e in scene.link.replies if e[0] > scene.tick)
    return [reply for _, _, reply in due]


def take_reports(scene: Scene) -> list[Report]:
    """Return the telemetry reports that arrive now, in order of sending."""
    return scene.link.reports.pop(scene.tick, [])


def _reaches(scene: Scene, agent: str) -> bool:
    asset = scene.assets.get(agent)
    return asset is None or radio.works(scene, asset)


def _in_order(scene: Scene, direction: str, agent: str, due: int) -> int:
    """Return when a message is due that may not overtake an earlier one; counts it as sent."""
    key = (direction, agent)
    due = max(due, scene.link.latest_due.get(key, 0))
    scene.link.latest_due[key] = due
    scene.link.sent += 1
    return due
