"""The radio: each asset's link with its losses and delays, and messages under way (CAP-05).

Commands and replies of one device never overtake each other. A command is lost if its device's link
is down when it would arrive; a reply or report is lost if the link is down when it is sent.
"""

import math

from pa_console.schema.command import CommandReply, DeviceCommand
from pa_console.schema.incident import JamArea, SetRadio
from pa_console.schema.telemetry import CommsStatus
from pa_console.schema.world import World
from pa_console.sim.scene import AssetState, Jam, RadioState, Report, Scene

DEGRADED = RadioState(latency_s=0.3, jitter_s=0.9, loss=0.3)
"""The link for `comms: degraded`; `lost` means an outage, `ok` the nominal link of the world."""


def works(scene: Scene, asset: AssetState) -> bool:
    """Return whether the link to `asset` works now: no outage, no jam."""
    return asset.radio.up and not (scene.link.jams and _jammed(scene, asset))


def quality(world: World, scene: Scene, asset: AssetState) -> CommsStatus:
    """Return the true quality of the link of `asset`."""
    if not works(scene, asset):
        return "lost"
    radio, nominal = asset.radio, world.radio
    slow = radio.latency_s + radio.jitter_s > nominal.latency_s + nominal.jitter_s
    return "degraded" if slow or radio.loss > nominal.loss else "ok"


def loses(scene: Scene, asset: AssetState) -> bool:
    """Decide at random whether a message on a working link is lost."""
    return asset.radio.loss > 0.0 and scene.rng.random() < asset.radio.loss


def delay(scene: Scene, asset: AssetState, dt_s: float) -> int:
    """Draw the number of steps that one message takes, at least one."""
    radio = asset.radio
    seconds = radio.latency_s
    if radio.jitter_s > 0.0:
        seconds += radio.jitter_s * scene.rng.random()
    return 1 if seconds <= dt_s else math.ceil(seconds / dt_s - 1e-9)


def set_comms(world: World, asset: AssetState, comms: CommsStatus) -> None:
    """Set the link of `asset` to ok, degraded or lost."""
    match comms:
        case "ok":
            asset.radio = RadioState.nominal(world.radio)
        case "degraded":
            asset.radio = DEGRADED
        case "lost":
            asset.radio = RadioState(
                asset.radio.latency_s, asset.radio.jitter_s, asset.radio.loss, up=False
            )


def set_radio(asset: AssetState, values: SetRadio) -> None:
    """Set the values of the link of `asset`."""
    asset.radio = RadioState(values.latency_s, values.jitter_s, values.loss, values.up)


def jam(world: World, scene: Scene, area: JamArea) -> None:
    """Jam an area from now on; an asset that leaves it regains its link."""
    until = None if area.seconds is None else scene.tick + round(area.seconds / world.dt_s)
    scene.link.jams = (*scene.link.jams, Jam(area.at, area.radius_m, until))


def end_jams(scene: Scene) -> None:
    """Drop the jams whose time is over."""
    if scene.link.jams:
        scene.link.jams = tuple(
            j for j in scene.link.jams if j.until_tick is None or j.until_tick > scene.tick
        )


def _jammed(scene: Scene, asset: AssetState) -> bool:
    return any(
        math.dist(jam.at, asset.position) <= jam.radius_m
        for jam in scene.link.jams
        if jam.until_tick is None or jam.until_tick > scene.tick
    )


def send_command(scene: Scene, command: DeviceCommand, dt_s: float) -> None:
    """Put `command` on the link; it arrives at the next step at the earliest.

    A command to an unknown agent goes to the gateway, which is wired.
    """
    asset = scene.assets.get(command.agent)
    if asset is not None and loses(scene, asset):
        return
    steps = 1 if asset is None else delay(scene, asset, dt_s)
    due = _in_order(scene, "to", command.agent, scene.tick + steps)
    scene.link.commands = (*scene.link.commands, (due, scene.link.sent, command))


def send_reply(scene: Scene, reply: CommandReply, dt_s: float) -> None:
    """Put a device's `reply` on the link; the gateway's own replies arrive at the next step."""
    asset = scene.assets.get(reply.agent)
    if asset is not None and (not works(scene, asset) or loses(scene, asset)):
        return
    steps = 1 if asset is None else delay(scene, asset, dt_s)
    due = _in_order(scene, "from", reply.agent, scene.tick + steps)
    scene.link.replies = (*scene.link.replies, (due, scene.link.sent, reply))


def send_report(scene: Scene, asset: AssetState, report: Report, dt_s: float) -> None:
    """Send the report of `asset` unless it is lost; a later report may overtake it."""
    if not loses(scene, asset):
        due = scene.tick + delay(scene, asset, dt_s)
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
    return asset is None or works(scene, asset)


def _in_order(scene: Scene, direction: str, agent: str, due: int) -> int:
    """Return the tick at which a message arrives without overtaking others; count the message."""
    key = (direction, agent)
    due = max(due, scene.link.latest_due.get(key, 0))
    scene.link.latest_due[key] = due
    scene.link.sent += 1
    return due
