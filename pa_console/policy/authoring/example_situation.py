"""The small checkpoint in which rule examples are stated, and what follows from a situation.

All assets stand at their posts, fully charged; every gate is covered by exactly one asset; no
track is known. Frames are the corners of a cross, 50 m from the checkpoint.
"""

import copy
import math
from typing import Any, cast

from pa_console.policy.checks.check_context import goes_to
from pa_console.schema.base import Point
from pa_console.schema.command import ADDRESSING
from pa_console.schema.plan import Action, Plan
from pa_console.schema.world import AssetKind, AssetSpec, Frame, Platform, World, Zone

Values = dict[str, Any]

DURATION_S = 60.0
RECON_S = 10.0
CONTACT_S = 30.0
TRACK_DISTANCE_M = 40.0

_PLATFORM = Platform(
    speed_mps=5.0,
    turn_rate_dps=90.0,
    radius_m=1.0,
    sensor_range_m=30.0,
    drain_idle_pct_per_min=0.1,
    drain_moving_pct_per_min=1.0,
)

_POSTS: dict[str, tuple[AssetKind, str]] = {
    "Drone_T01": ("uav", "WestGate"),
    "Drone_T02": ("uav", "NorthGate"),
    "Drone_T03": ("uav", "SouthGate"),
    "Drone_T04": ("uav", "Checkpoint"),
    "Ugv_T01": ("ugv", "EastGate"),
    "Ugv_T02": ("ugv", "Checkpoint"),
    "Robot_T01": ("robot", "Checkpoint"),
    "Robot_T02": ("robot", "Base"),
}

WORLD = World(
    name="example",
    title="The checkpoint of rule examples",
    standoff_m=10.0,
    coverage_grace_s=15.0,
    low_battery_pct=25.0,
    perimeter=((-60.0, -60.0), (60.0, -60.0), (60.0, 60.0), (-60.0, 60.0)),
    frames={
        "NorthGate": Frame(kind="gate", at=(0.0, 50.0)),
        "EastGate": Frame(kind="gate", at=(50.0, 0.0)),
        "SouthGate": Frame(kind="gate", at=(0.0, -50.0)),
        "WestGate": Frame(kind="gate", at=(-50.0, 0.0)),
        "Checkpoint": Frame(kind="post", at=(0.0, 0.0)),
        "Base": Frame(kind="base", at=(-30.0, -30.0)),
    },
    zones={
        "Depot": Zone(kind="restricted", polygon=((20.0, 20.0), (40.0, 20.0), (40.0, 40.0))),
    },
    platforms={"uav": _PLATFORM, "ugv": _PLATFORM, "robot": _PLATFORM},
    assets={name: AssetSpec(kind=kind, post=post) for name, (kind, post) in _POSTS.items()},
)


def situation(given: Values) -> Values:
    """Return the picture of `given` assets, tracks and gates as plain values.

    `available`, `low_battery` and the cover of each gate follow from the assets unless `given`
    says otherwise; a track needs no more than its gate.
    """
    picture: Values = {"tick": 0, "time_s": 100.0, "assets": {}, "tracks": {}, "gates": {}}
    assets: Values = given.get("assets", {})
    tracks: Values = given.get("tracks", {})
    for name in [*_POSTS, *(name for name in assets if name not in _POSTS)]:
        picture["assets"][name] = _asset(name, assets.get(name, {}))
    for name, facts in tracks.items():
        picture["tracks"][name] = _track(name, facts)
    picture["gates"] = overlay(covers(picture), given.get("gates", {}))
    return picture


def covers(picture: Values) -> Values:
    """Return the cover of each gate: every available asset that is at its post there."""
    watch = {
        gate: [
            name
            for name, asset in picture["assets"].items()
            if asset["available"] and asset["post"] == asset["at"] == gate
        ]
        for gate in WORLD.gates
    }
    return {gate: {"covered": bool(names), "by": names} for gate, names in watch.items()}


def carried_out(before: Values, plan: Plan) -> Values:
    """Return the picture when every action that can be done has been done."""
    after = copy.deepcopy(before)
    after["time_s"] += DURATION_S
    for action in plan.actions:
        asset = after["assets"].get(action.agent)
        frame = goes_to(action, WORLD)
        if asset is not None and asset["available"] and frame in WORLD.frames:
            asset.update(at=frame, post=frame, position=WORLD.frames[frame].at)
    after["gates"] = covers(after)
    return after


def example_timeline(before: Values, after: Values, plan: Plan) -> Values:
    """Return the timeline between two pictures: UAVs arrive after RECON_S, others CONTACT_S."""
    lost = {gate for gate in WORLD.gates if not after["gates"][gate]["covered"]}
    return {
        "duration_s": DURATION_S,
        "gates": {
            gate: {
                "covered_before": before["gates"][gate]["covered"],
                "covered_after": gate not in lost,
                "longest_gap_s": DURATION_S if gate in lost else 0.0,
            }
            for gate in WORLD.gates
        },
        "tracks": {name: _contacts(track, plan) for name, track in before["tracks"].items()},
        "assets": {
            action.agent: _outcome(action, before)
            for action in plan.actions
            if action.agent in before["assets"]
        },
    }


def overlay(base: Values, over: Values) -> Values:
    """Return `base` with the values of `over` laid over it, mappings merged at every depth."""
    merged = dict(base)
    for key, value in over.items():
        below = merged.get(key)
        if isinstance(below, dict) and isinstance(value, dict):
            merged[key] = overlay(cast("Values", below), cast("Values", value))
        else:
            merged[key] = value
    return merged


def _asset(name: str, facts: Values) -> Values:
    kind, post = _POSTS.get(name, ("uav", "Checkpoint"))
    asset: Values = {
        "id": name, "kind": kind, "at": post, "post": post, "heading_deg": 0.0, "speed_mps": 0.0,
        "status": "ok", "task": "idle", "battery_pct": 90.0, "comms": "ok", "stamp_s": 100.0,
    } | facts  # fmt: skip
    if "post" not in facts:
        asset["post"] = asset["at"]
    frame = WORLD.frames.get(asset["at"] or "Checkpoint")
    charge = asset["battery_pct"]
    derived: Values = {
        "position": frame.at if frame is not None else (0.0, 0.0),
        "low_battery": charge < WORLD.low_battery_pct,
        "available": asset["status"] != "failed" and asset["comms"] != "lost" and charge > 0,
    }
    return derived | asset


def _track(name: str, facts: Values) -> Values:
    gate = WORLD.frames.get(facts.get("gate", ""))
    return {
        "id": name, "kind": "vehicle", "position": _outside(gate.at if gate else (0.0, 50.0)),
        "heading_deg": 0.0, "speed_mps": 5.0, "distance_m": TRACK_DISTANCE_M, "stamp_s": 100.0,
    } | facts  # fmt: skip


def _outside(gate: Point) -> Point:
    """Return the position TRACK_DISTANCE_M outside of `gate`, seen from the middle."""
    stretch = 1.0 + TRACK_DISTANCE_M / math.hypot(*gate)
    return (gate[0] * stretch, gate[1] * stretch)


def _contacts(track: Values, plan: Plan) -> Values:
    kinds = {
        WORLD.assets[action.agent].kind
        for action in plan.actions
        if action.agent in WORLD.assets and goes_to(action, WORLD) == track["gate"]
    }
    seen = 0.0 if track.get("observed") else RECON_S if "uav" in kinds else None
    return {"observed_s": seen, "ground_contact_s": CONTACT_S if kinds - {"uav"} else None}


def _outcome(action: Action, before: Values) -> Values:
    asset, frame = before["assets"][action.agent], goes_to(action, WORLD)
    there = any(track["gate"] == frame for track in before["tracks"].values())
    detail = ""
    if not asset["available"]:
        detail = f"{action.agent} is not available"
    elif frame and frame not in WORLD.frames:
        detail = f"no frame {frame}"
    elif action.verb in ADDRESSING and not there:
        detail = f"no track at {frame}"
    return {"finished": not detail, "detail": detail, "least_battery_pct": asset["battery_pct"]}
