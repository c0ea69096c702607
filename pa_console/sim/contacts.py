"""The true state of vehicles and persons: how they appear, drive and leave."""

import math

import numpy as np
import numpy.typing as npt

from pa_console.schema.base import Point
from pa_console.schema.incident import RevealTrack, SpawnTrack
from pa_console.schema.world import AssetKind
from pa_console.sim.scene import Scene
from pa_console.sim.sensing_state import ContactState
from pa_console.sim.worlds.terrain import QUEUE_GAP_M, Terrain

COMPLIES_AFTER_S = 2.0
"""Seconds that a contact waits after a warning before it leaves."""
BUMPER_M = 3.0
"""The distance in metres at which a contact that ignores a warning passes ground assets."""
_STOPPED_MPS = 0.05
_ASIDE_DEG = (30, -30, 60, -60, 85, -85)
Points = npt.NDArray[np.float64]


def spawn(terrain: Terrain, scene: Scene, incident: SpawnTrack) -> ContactState:
    """Add a new contact on a lane of its gate, behind the contacts already there.

    It starts `distance_m` from the gate, but never nearer than the waiting point. Raises ValueError
    if no lane leads to the gate.
    """
    lane = pick_lane(terrain, scene, incident.gate)
    line = terrain.lanes[lane]
    start = 0.0 if incident.distance_m is None else line.first_within(incident.distance_m)
    state = scene.sensing
    ahead = [
        c.travelled - QUEUE_GAP_M for c in state.contacts.values() if c.lane == lane and c.on_lane
    ]
    state.spawned += 1
    travelled = max(0.0, min([start, line.waiting_m, *ahead]))
    (x, y), heading = line.locate(travelled)
    contact = ContactState(
        id=f"Contact_{state.spawned:02d}",
        kind=incident.track,
        gate=incident.gate,
        lane=lane,
        travelled=travelled,
        x=x,
        y=y,
        heading=heading,
        cruise_mps=incident.speed_mps,
        identity=incident.identity,
        intent=incident.intent,
        when_warned=incident.when_warned,
        noncombatants=incident.noncombatants,
        emergency=incident.emergency,
        name=incident.name,
    )
    state.contacts[contact.id] = contact
    if incident.name is not None:
        state.named[incident.name] = contact.id
    return contact


def pick_lane(terrain: Terrain, scene: Scene, gate: str) -> str:
    """Return a lane to `gate`, drawn if there are several; raises ValueError if there is none."""
    lanes = terrain.lanes_to(gate)
    if not lanes:
        gates = ", ".join(sorted({lane.gate for lane in terrain.world.lanes.values()})) or "none"
        raise ValueError(f"no lane leads to {gate!r}; gates with a lane: {gates}")
    return lanes[0] if len(lanes) == 1 else scene.rng.choice(lanes)


def turn(scene: Scene, incident: RevealTrack) -> None:
    """Change the true properties of a contact that a script named, unless it has left.

    Sensors must watch the contact again before they can detect a changed intent. Raises ValueError
    if no contact with this name was ever spawned.
    """
    state = scene.sensing
    if incident.track not in state.named:
        names = ", ".join(state.named) or "none"
        raise ValueError(f"there is no contact named {incident.track!r}; known: {names}")
    contact = state.contacts.get(state.named[incident.track])
    if contact is None:
        return
    contact.identity = incident.identity or contact.identity
    contact.when_warned = incident.when_warned or contact.when_warned
    if incident.intent is not None and incident.intent != contact.intent:
        contact.intent = incident.intent
        state.watched = {key: n for key, n in state.watched.items() if key[1] != contact.id}


def remove(scene: Scene, contact_id: str) -> None:
    """Remove a contact from the true state, with the sensors' findings about it."""
    state = scene.sensing
    del state.contacts[contact_id]
    state.watched = {key: n for key, n in state.watched.items() if key[1] != contact_id}
    state.findings = {key: f for key, f in state.findings.items() if key[1] != contact_id}


class _GroundAssets:
    """The positions of the ground assets at this step; collected only if a contact moves."""

    def __init__(self, scene: Scene) -> None:
        self._assets = scene.assets.values()
        self._at: Points | None = None

    def nears(self, here: Point, there: Point, keeps_m: float) -> bool:
        """Return whether a move from `here` to `there` ends less than `keeps_m` from an asset.

        Moving away from an asset that is already too near is allowed.
        """
        if self._at is None:
            at = [(asset.x, asset.y) for asset in self._assets if asset.kind != "uav"]
            self._at = np.array(at).reshape(-1, 2)
        after = np.hypot(self._at[:, 0] - there[0], self._at[:, 1] - there[1])
        close = after < keeps_m
        if not close.any():
            return False
        at = self._at[close]
        before = np.hypot(at[:, 0] - here[0], at[:, 1] - here[1])
        return bool((after[close] < before).any())


def advance(terrain: Terrain, scene: Scene, dt_s: float) -> None:
    """Move every contact by one step; remove those that have left at the far end of their lane."""
    if not scene.contacts:
        return
    ground = _GroundAssets(scene)
    for contact in list(scene.contacts.values()):
        warned = contact.warned_tick is not None
        if warned and contact.when_warned == "stop":
            contact.speed = 0.0
            contact.status = "inside" if _inside(terrain, contact) else "stopped"
        elif warned and contact.when_warned == "leave":
            _leave(terrain, scene, contact, dt_s)
        elif contact.on_lane and contact.status != "leaving":
            _approach(terrain, scene, contact, ground, dt_s)
        elif contact.status == "leaving":
            _leave(terrain, scene, contact, dt_s)
        else:
            _drive(terrain, scene, contact, ground, dt_s)


def way_in(terrain: Terrain, gate: str) -> tuple[Point, ...]:
    """Return the waypoints from a gate's lane to the nearest post behind the gate, or to the base.

    They lead through the gate and then along a ground asset's route, or straight on if there is no
    route.
    """
    world = terrain.world
    start = world.frames[gate].at
    goals = [frame.at for frame in world.frames.values() if frame.kind == "post"]
    goal = min(goals or [world.frames[world.base].at], key=lambda at: (math.dist(at, start), at))
    return (start, *_ground_way(terrain, start, goal))


def _ground_way(terrain: Terrain, start: Point, goal: Point) -> tuple[Point, ...]:
    """Return the waypoints of a ground asset's route after `start`, or only its end without one."""
    kinds: list[AssetKind] = [kind for kind in terrain.world.platforms if kind != "uav"]
    route = terrain.planner.route(kinds[0], start, goal) if kinds else None
    return route or (goal,)


def _inside(terrain: Terrain, contact: ContactState) -> bool:
    return not contact.on_lane and terrain.depth(contact.position) > 0.0


def _leave(terrain: Terrain, scene: Scene, contact: ContactState, dt_s: float) -> None:
    """Wait a moment after the warning, then drive back the way it came."""
    waited_s = (scene.tick - (contact.warned_tick or 0)) * dt_s
    if contact.status != "leaving" and waited_s < COMPLIES_AFTER_S:
        contact.speed = 0.0
        contact.status = "inside" if _inside(terrain, contact) else "stopped"
        return
    line = terrain.lanes[contact.lane]
    if not contact.on_lane:
        if contact.status != "leaving":
            contact.route = _way_out(terrain, contact)
        contact.status = "leaving"
        _follow(contact, contact.cruise_mps * dt_s, dt_s)
        if not contact.route:
            contact.on_lane, contact.travelled = True, line.length_m
        return
    contact.status, contact.speed = "leaving", contact.cruise_mps
    contact.travelled -= contact.speed * dt_s
    if contact.travelled <= 0.0:
        remove(scene, contact.id)
        return
    (contact.x, contact.y), heading = line.locate(contact.travelled)
    contact.heading = math.remainder(heading + math.pi, math.tau)


def _way_out(terrain: Terrain, contact: ContactState) -> tuple[Point, ...]:
    """Return the waypoints from the contact's place back to the end of its lane."""
    end = terrain.lanes[contact.lane].locate(math.inf)[0]
    if not _inside(terrain, contact):
        return (end,)
    gate = terrain.world.frames[contact.gate].at
    return (*_ground_way(terrain, contact.position, gate), end)


def _approach(
    terrain: Terrain, scene: Scene, contact: ContactState, ground: _GroundAssets, dt_s: float
) -> None:
    """Drive on up to the waiting point, the contact in front, or a ground asset in the way.

    A contact that ignores a warning leaves its lane at the waiting point and drives to the gate.
    """
    line = terrain.lanes[contact.lane]
    limit = line.waiting_m
    for other in scene.contacts.values():
        in_front = other.travelled > contact.travelled or (
            other.travelled == contact.travelled and other.id < contact.id
        )
        if other is not contact and other.on_lane and other.lane == contact.lane and in_front:
            limit = min(limit, other.travelled - QUEUE_GAP_M)
    step = min(contact.cruise_mps * dt_s, max(0.0, limit - contact.travelled))
    there, heading = line.locate(contact.travelled + step)
    warned = contact.warned_tick is not None
    keeps = BUMPER_M if warned else terrain.world.standoff_m + 0.2
    if step > 0.0 and not ground.nears(contact.position, there, keeps):
        contact.travelled += step
        (contact.x, contact.y), contact.heading = there, heading
    else:
        step = 0.0
    contact.speed = step / dt_s
    contact.status = "approaching" if contact.speed > _STOPPED_MPS else "stopped"
    if warned and contact.travelled >= line.waiting_m:
        end = line.locate(line.length_m)[0]
        contact.on_lane, contact.route = False, (end, *way_in(terrain, contact.gate))


def _drive(
    terrain: Terrain, scene: Scene, contact: ContactState, ground: _GroundAssets, dt_s: float
) -> None:
    """Drive on through the gate and inside; stop at a blocked gate, and steer round assets."""
    gate_ahead = terrain.world.frames[contact.gate].at in contact.route
    if gate_ahead and gate_blocked(terrain, scene, contact.gate):
        contact.speed = 0.0
    else:
        was = (contact.x, contact.y, contact.heading, contact.route)
        _follow(contact, contact.cruise_mps * dt_s, dt_s)
        if ground.nears((was[0], was[1]), contact.position, BUMPER_M):
            contact.x, contact.y, contact.heading, contact.route = was
            _pass_by(terrain, contact, ground, dt_s)
    if _inside(terrain, contact):
        contact.status = "inside"
    else:
        contact.status = "approaching" if contact.speed > _STOPPED_MPS else "stopped"


def _pass_by(terrain: Terrain, contact: ContactState, ground: _GroundAssets, dt_s: float) -> None:
    """Steer round a ground asset; stop if there is no way past it.

    A waypoint near the contact, even the last one, counts as reached: an asset may stand on it.
    """
    here, step = contact.position, contact.cruise_mps * dt_s
    while contact.route and math.dist(here, contact.route[0]) <= BUMPER_M + step:
        contact.route = contact.route[1:]
    target = contact.route[0] if contact.route else here
    ahead = math.atan2(target[1] - here[1], target[0] - here[0])
    contact.speed = 0.0
    for turn_deg in _ASIDE_DEG if here != target else ():
        way = ahead + math.radians(turn_deg)
        there = (here[0] + step * math.cos(way), here[1] + step * math.sin(way))
        clear = terrain.in_sight(np.array([here]), np.array([there]))[0]
        if clear and not ground.nears(here, there, BUMPER_M):
            contact.x, contact.y = there
            contact.heading, contact.speed = way, contact.cruise_mps
            return


def _follow(contact: ContactState, step_m: float, dt_s: float) -> None:
    """Advance the contact by `step_m` along its route."""
    gone, left = 0.0, step_m
    while contact.route and left > 1e-9:
        target = contact.route[0]
        gap = math.dist(contact.position, target)
        if gap > left:
            contact.heading = math.atan2(target[1] - contact.y, target[0] - contact.x)
            contact.x += left * math.cos(contact.heading)
            contact.y += left * math.sin(contact.heading)
            gone, left = gone + left, 0.0
        else:
            contact.x, contact.y = target
            contact.route = contact.route[1:]
            gone, left = gone + gap, left - gap
    contact.speed = gone / dt_s


def gate_blocked(terrain: Terrain, scene: Scene, gate: str) -> bool:
    """Return whether a working UGV blocks `gate`, so that nothing can pass."""
    return any(
        asset.task == "blocking" and not asset.down and terrain.frame_at(asset.x, asset.y) == gate
        for asset in scene.assets.values()
    )
