"""The behaviour of devices: carrying out commands, and acting without a link (CAP-05).

At a gate, a ground robot identifies and warns contacts (WF-01, ROE-02, CAP-03). Its proximity
sensors detect nearby contacts exactly in any weather; the station receives their results in the
robot's reports. The track ids in its replies come from the station.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Literal

from pa_console.schema.command import (
    ADDRESSING,
    COMMANDS,
    STILL,
    CommandReply,
    DeviceCommand,
    ReplyStatus,
    Verb,
)
from pa_console.schema.telemetry import Task
from pa_console.sim import radio
from pa_console.sim.motion import unstick, way_left
from pa_console.sim.scene import AssetState, Scene, rouse
from pa_console.sim.sensing.evidence import identity_of
from pa_console.sim.sensing.tracker import name_of
from pa_console.sim.sensing_state import ContactFinding, ContactState
from pa_console.sim.worlds.terrain import Terrain

PROGRESS_S = 5.0
_REMEMBERED = 32
IDENTIFY_S = 4.0
WARN_S = 3.0
Admit = Callable[[DeviceCommand], str]
"""A function that returns why a device may not carry out a command, or '' if it may.

It is called once for each command id.
"""
Ending = tuple[Literal["done", "failed"] | None, str]


def listen(terrain: Terrain, scene: Scene) -> None:
    """Deliver the station's heartbeat, sent once per telemetry period, to every device.

    A device without a heartbeat for its platform's `lost_link_after_s` ends its command and holds
    or returns to base. When the link is back, the device reports the end of its command.
    """
    world = terrain.world
    for asset in scene.assets.values():
        if radio.works(scene, asset) and not radio.loses(scene, asset):
            asset.heard_tick = scene.tick
            if asset.cut_off:
                note_heard(terrain, scene, asset)
        elif not asset.cut_off and not asset.down:
            silence_s = (scene.tick - asset.heard_tick) * world.dt_s
            if silence_s >= world.platforms[asset.kind].lost_link_after_s:
                asset.cut_off = True
                rouse(world, scene, asset)
                asset.owes = (*asset.owes, *lose_link(terrain, scene, asset))


def note_heard(terrain: Terrain, scene: Scene, asset: AssetState) -> None:
    """Record that a message from the station has just reached `asset`."""
    asset.heard_tick = scene.tick
    if asset.cut_off:
        owes, asset.cut_off, asset.owes = asset.owes, False, ()
        for reply in owes:
            radio.send_reply(scene, reply, terrain.world.dt_s)


def accept(
    terrain: Terrain, scene: Scene, command: DeviceCommand, admit: Admit | None = None
) -> Iterator[CommandReply]:
    """Process a command as the device does, if `admit` allows it; yield the replies.

    A command whose id has arrived before is not carried out again; the last reply to it is
    repeated. The exception is a hold, which always stops an asset under way.
    """
    asset = scene.assets.get(command.agent)
    if asset is None:
        names = ", ".join(scene.assets)
        yield _answer(scene, command, "refused", f"there is no asset of this name; known: {names}")
        return
    known_reply = next((r for r in asset.answered if r.command_id == command.command_id), None)
    under_way = asset.command is not None or bool(asset.route)
    if known_reply is not None and not (command.verb == "hold" and under_way):
        yield known_reply
        return
    problem = admit(command) if admit is not None else ""
    problem = problem or _objection(terrain, asset, command)
    if problem:
        yield _remember(asset, _answer(scene, command, "refused", problem))
        return
    yield _remember(asset, _answer(scene, command, "acknowledged", ""))
    if command.verb == "report":
        yield _remember(asset, _answer(scene, command, "done", status_text(terrain, scene, asset)))
        return
    rouse(terrain.world, scene, asset)
    if asset.command is not None:
        yield _close(scene, asset, "failed", "superseded")
    asset.command = command
    if command.verb == "hold":
        _stand(terrain, asset, "holding")
        yield _close(scene, asset, "done", f"holding at {asset.post or 'its place'}")
        return
    asset.task = "returning" if command.verb == "return_to_base" else "moving"
    problem = _set_out(terrain, scene, asset, command.target or terrain.world.base)
    if problem:
        yield from _give_up(terrain, scene, asset, problem)


def lose_link(terrain: Terrain, scene: Scene, asset: AssetState) -> Iterator[CommandReply]:
    """Act as the platform does without a link; yield the reply that ends the command.

    The reply is sent once the link is back. An asset that holds stays at its post if it has no
    command; an asset that returns to base leaves its post.
    """
    returns = terrain.world.platforms[asset.kind].lost_link == "return_to_base"
    if asset.command is not None:
        yield from _give_up(terrain, scene, asset, "link lost", "holding")
    elif asset.route and not returns:
        _stand(terrain, asset, "holding")
    at_base = terrain.frame_at(asset.x, asset.y) == terrain.world.base
    if returns and not at_base and asset.task != "returning":
        asset.task = "returning"
        if _set_out(terrain, scene, asset, terrain.world.base):
            _stand(terrain, asset, "holding")


def work(terrain: Terrain, scene: Scene, asset: AssetState) -> Iterable[CommandReply]:
    """Advance the asset's command after a step; return the replies."""
    if asset.down:
        return _break_down(scene, asset)
    if asset.route and (trouble := unstick(terrain, scene, asset)):
        return _give_up(terrain, scene, asset, trouble)
    if not asset.route:
        return _do_there(terrain, scene, asset)
    command = asset.command
    if command is None or (scene.tick - asset.progress_tick) * terrain.world.dt_s < PROGRESS_S:
        return ()
    return _tell_progress(scene, asset, command)


def _tell_progress(
    scene: Scene, asset: AssetState, command: DeviceCommand
) -> Iterable[CommandReply]:
    """Report the progress of an asset under way."""
    asset.progress_tick = scene.tick
    held = ""
    if asset.held_by:
        contact = scene.contacts.get(asset.held_by)
        name = called(scene, contact) if contact else "a contact"
        held = f", keeping its distance from {name}"
    text = f"{way_left(asset):.0f} m to go{held}"
    return (_remember(asset, _answer(scene, command, "progress", text)),)


def _do_there(terrain: Terrain, scene: Scene, asset: AssetState) -> Iterator[CommandReply]:
    """Carry out the command at its target, where the asset now is."""
    command = asset.command
    if command is None:
        if asset.task in ("moving", "returning"):
            asset.task = "charging" if asset.task == "returning" else "holding"
        return
    if asset.task in ("moving", "returning"):
        asset.task = COMMANDS[command.verb].task or asset.task
    target = command.target or terrain.world.base
    if command.verb not in ADDRESSING:
        yield _close(scene, asset, "done", f"at {target}")
        return
    if not asset.announced:
        asset.announced = True
        yield _remember(asset, _answer(scene, command, "progress", f"at {target}"))
    status, detail = attend(terrain, scene, asset, command.verb, target)
    if status is not None:
        asset.task = "holding"
        yield _close(scene, asset, status, detail)


def status_text(terrain: Terrain, scene: Scene, asset: AssetState) -> str:
    """Return an asset's brief report: place, task, battery, link, visible contacts (WF-09)."""
    at = terrain.frame_at(asset.x, asset.y)
    place = f"at {at}" if at else f"on the way to {asset.post}" if asset.post else "between frames"
    reach = terrain.world.platforms[asset.kind].sensor_range_m
    near = [c for c in scene.contacts.values() if math.dist(c.position, asset.position) <= reach]
    sees = f", sees {', '.join(called(scene, contact) for contact in near)}" if near else ""
    comms = radio.quality(terrain.world, scene, asset)
    return f"{place}, {asset.task}, battery {asset.battery:.0f} %, comms {comms}{sees}"


def _objection(terrain: Terrain, asset: AssetState, command: DeviceCommand) -> str:
    """Return why the device cannot carry out the command, or '' if it can."""
    spec = COMMANDS[command.verb]
    if asset.failed:
        return "the asset has failed"
    if asset.battery <= 0.0:
        return "the battery is empty"
    if asset.manual and command.verb not in STILL:
        return "it is under manual control"
    if asset.kind not in spec.kinds:
        return f"a {asset.kind} cannot {command.verb}"
    if spec.takes_frame and command.target not in terrain.world.frames:
        return f"unknown frame {command.target!r}; known: {', '.join(terrain.world.frames)}"
    if not spec.takes_frame and command.target is not None:
        return f"{command.verb} takes no frame"
    return ""


def drive_by_hand(terrain: Terrain, scene: Scene, asset: AssetState, frame: str | None) -> None:
    """Put `asset` under manual control; a person drives it to `frame` if one is given.

    Its command ends without a reply, because the device gets no message. Its post stays the same.
    Raises ValueError if it cannot be driven there.
    """
    post = asset.post
    asset.stop("idle")
    if frame is not None and (problem := _set_out(terrain, scene, asset, frame)):
        asset.post = post
        raise ValueError(f"{asset.id}: {problem}")
    asset.command, asset.manual, asset.post = None, True, post
    asset.task = "moving" if asset.route else "idle"


def let_go(terrain: Terrain, asset: AssetState) -> None:
    """End manual control of `asset`; it stops, and its post is the frame that it is at, if any."""
    if asset.manual:
        asset.manual = False
        _stand(terrain, asset, "none" if asset.down else "idle")


def _set_out(terrain: Terrain, scene: Scene, asset: AssetState, target: str) -> str:
    """Give the asset a place at `target` and a route to it; return why not, '' if it has both."""
    asset.dwell, asset.stalls, asset.announced = 0, 0, False
    asset.progress_tick = asset.nearest_tick = scene.tick
    asset.nearest_m, asset.held_by = math.inf, ""
    stays = asset.post == target and terrain.frame_at(asset.x, asset.y) == target
    asset.post = target
    if stays:
        asset.station, asset.route = asset.position, ()
        return ""
    air = asset.kind == "uav"
    taken = [
        other.position if other.down else other.station
        for other in scene.assets.values()
        if other is not asset and (other.kind == "uav") == air
    ]
    place = terrain.free_place(target, asset.kind, taken)
    if place is None:
        return f"there is no free place for a {asset.kind} at {target}"
    route = terrain.planner.route(asset.kind, asset.position, place, asset.obstructions)
    if route is None:
        return f"{target} cannot be reached"
    asset.origin, asset.station, asset.route = asset.position, place, route
    return ""


def _give_up(
    terrain: Terrain, scene: Scene, asset: AssetState, reason: str, task: Task = "idle"
) -> Iterator[CommandReply]:
    """Stop the asset where it is; if it has a command, the command fails."""
    _stand(terrain, asset, task)
    if asset.command is not None:
        yield _close(scene, asset, "failed", reason)


def _stand(terrain: Terrain, asset: AssetState, task: Task) -> None:
    """Stop the asset where it is; its post becomes the frame that it is at, if any."""
    asset.post = terrain.frame_at(asset.x, asset.y)
    asset.stop(task)


def _break_down(scene: Scene, asset: AssetState) -> Iterator[CommandReply]:
    """Stop an asset that has just failed; if it has a command, the command fails too."""
    if asset.route or asset.task != "none":
        asset.stop("none")
    if asset.command is not None:
        reason = "the asset has failed" if asset.failed else "the battery is empty"
        yield _close(scene, asset, "failed", reason)


def _close(scene: Scene, asset: AssetState, status: ReplyStatus, detail: str) -> CommandReply:
    """End the asset's command and return the reply."""
    assert asset.command is not None
    reply = _answer(scene, asset.command, status, detail)
    asset.command = None
    return _remember(asset, reply)


def _answer(scene: Scene, command: DeviceCommand, status: ReplyStatus, detail: str) -> CommandReply:
    return CommandReply(
        command_id=command.command_id,
        agent=command.agent,
        status=status,
        tick=scene.tick,
        detail=detail,
    )


def _remember(asset: AssetState, reply: CommandReply) -> CommandReply:
    """Store the last reply to each command id, for the latest ids only; return `reply`."""
    others = tuple(r for r in asset.answered if r.command_id != reply.command_id)
    asset.answered = (*others, reply)[-_REMEMBERED:]
    return reply


def attend(terrain: Terrain, scene: Scene, asset: AssetState, verb: Verb, gate: str) -> Ending:
    """Advance the command `identify` or `warn` of an asset at `gate`; return its status and reply.

    The status is None until the command ends. The command fails at once if no contact is at the
    gate or on its way there. It waits until the contact is within sensor range, and then takes a
    few seconds. The result is the robot's own opinion: a hostile intent needs another sensor to
    confirm it (ROE-01).
    """
    contact = _choose(scene, asset, verb, gate)
    if contact is None:
        return "failed", f"no track at {gate}"
    gap_m = math.dist(contact.position, asset.position)
    if gap_m > terrain.world.platforms[asset.kind].sensor_range_m:
        asset.dwell = 0
        return None, ""
    asset.dwell += 1
    needed = IDENTIFY_S if verb == "identify" else WARN_S
    if asset.dwell * terrain.world.dt_s < needed:
        return None, ""
    if verb == "warn" and contact.warned_tick is None:
        contact.warned_tick = scene.tick
    _note(scene, asset, contact, verb)
    name = called(scene, contact)
    if verb == "warn":
        return "done", f"warned {name}"
    looks = "undecided" if contact.intent == "unknown" else contact.intent
    return "done", f"{name} is {contact.identity}, looks {looks}"


def called(scene: Scene, contact: ContactState) -> str:
    """Return the track id of a contact, or its kind if the station does not track it."""
    return name_of(scene, contact.id) or f"a {contact.kind}"


def _note(scene: Scene, asset: AssetState, contact: ContactState, verb: str) -> None:
    """Store the asset's finding, which is sent with its reports."""
    findings, key = scene.sensing.findings, (asset.id, contact.id)
    before = findings.get(key, ContactFinding())
    if verb == "identify":
        findings[key] = ContactFinding(
            contact.identity, contact.intent, before.warned_tick, scene.tick
        )
    else:
        findings[key] = replace(before, warned_tick=contact.warned_tick)


def _choose(scene: Scene, asset: AssetState, verb: str, gate: str) -> ContactState | None:
    """Return the nearest contact at `gate` that still needs `verb`, or else the nearest contact.

    A contact counts as identified if the station, which sent the command, has identified it.
    """
    here = [c for c in scene.contacts.values() if c.gate == gate and c.status != "leaving"]

    def rank(contact: ContactState) -> tuple[bool, float, str]:
        file = scene.sensing.files.get(contact.id)
        identified = file is not None and identity_of(file) != "unknown"
        done = identified if verb == "identify" else contact.warned_tick is not None
        return done, math.dist(contact.position, asset.position), contact.id

    return min(here, key=rank, default=None)
