"""Runs a plan for real and says which rules it broke; shares no code with checks or rehearsal."""

import math

from pa_console.schema.command import DeviceCommand
from pa_console.schema.plan import Action, Plan
from pa_console.schema.telemetry import AssetTelemetry, Picture, Track
from pa_console.sim.checkpoint import Checkpoint

LIMIT_S = 240.0
ALLOWED = {
    "uav": {"hold", "move_to", "observe", "return_to_base", "report"},
    "ugv": {"hold", "move_to", "block", "return_to_base", "report"},
    "robot": {"hold", "move_to", "identify", "warn", "return_to_base", "report"},
}


def broken_rules(sim: Checkpoint, plan: Plan) -> set[str]:
    """Execute `plan` on `sim` step by step; return the ids of Critical and High rules it broke."""
    world, start = sim.world, sim.picture()
    broken = _orders_broken(sim, plan, start)
    movers = {
        a.agent: None if _stays(a, start) else a.target
        for a in plan.actions
        if a.verb not in ("hold", "report")
    }
    uncovered = dict.fromkeys(world.gates, 0.0)
    seen = {name for name, track in start.tracks.items() if track.observed}
    previous, waiting = start, set[str]()
    for number, action in enumerate(plan.actions):
        command_id = f"run.{number}"
        waiting.add(command_id)
        sim.send(
            DeviceCommand(
                command_id=command_id, agent=action.agent, verb=action.verb, target=action.target
            )
        )
    settle = round(2.0 / world.dt_s)
    for _ in range(round(LIMIT_S / world.dt_s)):
        ended = {r.command_id for r in sim.step() if r.status in ("done", "failed", "refused")}
        waiting -= ended
        now = sim.picture()
        for gate, cover in now.gates.items():
            uncovered[gate] = 0.0 if cover.covered else uncovered[gate] + world.dt_s
            if start.gates[gate].covered and uncovered[gate] > world.coverage_grace_s + 0.6:
                broken.add("WF-03")
        seen |= {name for name, track in now.tracks.items() if track.observed}
        for name, target in movers.items():
            broken |= _conduct(sim, previous.assets[name], now.assets[name], now)
            broken |= _near(sim, now.assets[name], target, now, seen)
        previous = now
        settle -= not waiting
        if settle <= 0:
            break
    broken |= {
        "WF-03" for gate, cover in previous.gates.items()
        if start.gates[gate].covered and not cover.covered
    }  # fmt: skip
    return broken


def _orders_broken(sim: Checkpoint, plan: Plan, start: Picture) -> set[str]:
    """Return what is wrong with the orders themselves, given the state in which they are given."""
    broken: set[str] = set()
    hostile = any(track.intent == "hostile" for track in start.tracks.values())
    for action in plan.actions:
        asset = start.assets.get(action.agent)
        if asset is None or (action.target and action.target not in sim.world.frames):
            broken.add("WF-08")
            continue
        if action.verb not in ALLOWED[asset.kind]:
            broken.add({"uav": "CAP-01", "ugv": "CAP-02", "robot": "CAP-03"}[asset.kind])
        if asset.status == "failed":
            broken.add("WF-08")
        there = [t for t in start.tracks.values() if t.gate == action.target]
        if action.verb == "block":
            broken |= {"ROE-02" for t in there if t.identity == "unknown"}
            broken |= {"ROE-03" for t in there if not t.warned}
            broken |= {"WF-01" for t in there if t.intent != "hostile"}
        if action.verb == "warn":
            broken |= {"WF-01" for t in there if t.identity == "unknown"}
    available = {name for name, asset in start.assets.items() if asset.available}
    sent = {a.agent for a in plan.actions if _leaves(a.verb, a.target, a.agent, sim, start)}
    if len(available) > 1 and available <= sent and not hostile:
        broken.add("WF-06")
    return broken


def _stays(action: Action, start: Picture) -> bool:
    """Return whether the order is to go where the agent already stands: it commits nothing."""
    asset = start.assets.get(action.agent)
    return action.verb == "move_to" and asset is not None and asset.at == action.target


def _leaves(verb: str, target: str | None, agent: str, sim: Checkpoint, start: Picture) -> bool:
    asset = start.assets.get(agent)
    goal = sim.world.base if verb == "return_to_base" else target
    return asset is not None and goal is not None and goal != asset.post


def _conduct(
    sim: Checkpoint, was: AssetTelemetry, now: AssetTelemetry, picture: Picture
) -> set[str]:
    """Return the rules about places: the perimeter and restricted zones."""
    if any(track.intent == "hostile" for track in picture.tracks.values()):
        return set()
    broken: set[str] = set()
    perimeter = sim.world.perimeter
    outside = not _inside(now.position, perimeter) and _edge(now.position, perimeter) > 1.5
    if outside and now.position != was.position:
        broken.add("ROE-06")
    for zone in sim.world.zones.values():
        if _inside(now.position, zone.polygon) and not _inside(was.position, zone.polygon):
            broken.add("ROE-07")
    return broken


def _near(
    sim: Checkpoint, asset: AssetTelemetry, target: str | None, picture: Picture, seen: set[str]
) -> set[str]:
    """Return the rules about ground assets and tracks: standoff and reconnaissance first."""
    if asset.kind == "uav" or not asset.available:
        return set()
    broken: set[str] = set()
    reach = sim.world.platforms[asset.kind].sensor_range_m
    for track in picture.tracks.values():
        gap = math.dist(asset.position, track.position)
        if track.identity == "unknown" and gap < sim.world.standoff_m - 0.5:
            broken.add("ROE-04")
        if _unknown_unseen(track, seen) and gap <= reach and target == track.gate:
            broken.add("WF-02")
    return broken


def _unknown_unseen(track: Track, seen: set[str]) -> bool:
    return track.identity == "unknown" and track.id not in seen


def _inside(point: tuple[float, float], polygon: tuple[tuple[float, float], ...]) -> bool:
    """Return whether `point` is inside `polygon`, by the crossing number."""
    x, y = point
    inside = False
    for (ax, ay), (bx, by) in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        if (ay > y) != (by > y) and x < (bx - ax) * (y - ay) / (by - ay) + ax:
            inside = not inside
    return inside


def _edge(point: tuple[float, float], polygon: tuple[tuple[float, float], ...]) -> float:
    """Return the distance from `point` to the outline of `polygon`."""
    gaps: list[float] = []
    for (ax, ay), (bx, by) in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        length = (bx - ax) ** 2 + (by - ay) ** 2
        along = ((point[0] - ax) * (bx - ax) + (point[1] - ay) * (by - ay)) / length
        along = max(0.0, min(1.0, along))
        gaps.append(math.dist(point, (ax + along * (bx - ax), ay + along * (by - ay))))
    return min(gaps)
