"""The examples of a rule: plans and moments that must pass or fail, and how they are run.

They refer to a small checkpoint, `WORLD`. All assets stand at their posts, fully charged;
every gate is covered by exactly one asset; no track is known. Frames are the corners of a cross,
50 m from the checkpoint.

Each entry of `moments` lists the changes since the previous moment. The first entry changes an
uneventful moment at the example checkpoint: every gate covered, no tracks, no orders.

at       time in seconds; by default, one second later than the previous moment
tracks   facts of tracks, e.g. {V1: {gate: WestGate, observed: true}}; {V1: null} removes V1
covered  whether gates are covered, e.g. {SouthGate: false}
up       whether the plan's assets are available, e.g. {Robot_T01: false}
orders   all orders under way, e.g. [[Ugv_T02, block WestGate], [Drone_T04, hold, done]]

If only the gate of a track is given, the track is unknown, approaching, unobserved and unwarned.

`given` lists the differences of the situation from the example checkpoint:

assets    facts of assets before the plan, e.g. {Drone_T03: {status: failed}}
tracks    tracks before the plan, e.g. {V1: {gate: WestGate, identity: unknown}}
gates     cover before the plan, if it does not follow from the assets
after     facts of the picture after the plan, if they do not follow from the plan
timeline  facts of the rehearsal, if they differ from those of an uneventful rehearsal
sightings earlier detections, e.g. [{track: V1, place: Depot, noncombatants: true, age_s: 40}];
          for a track that is still known, its present facts are used instead
"""

import copy
import json
import math
from collections.abc import Iterable
from datetime import UTC, datetime
from typing import Any, cast

from pydantic import TypeAdapter, ValidationError

from pa_console.policy.findings import finding
from pa_console.policy.monitor import Monitor
from pa_console.policy.rule_checks import check_rule
from pa_console.policy.rule_variables import Sightings, TrackSighting, goes_to
from pa_console.policy.rulebook import CompiledRule, Rulebook, compile_rule
from pa_console.schema.base import Point
from pa_console.schema.command import ADDRESSING
from pa_console.schema.finding import Finding
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import Moment, Rehearsal
from pa_console.schema.rule import Rule, RuleExample
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
    zones={"Depot": Zone(kind="restricted", polygon=((20.0, 20.0), (40.0, 20.0), (40.0, 40.0)))},
    platforms={"uav": _PLATFORM, "ugv": _PLATFORM, "robot": _PLATFORM},
    assets={name: AssetSpec(kind=kind, post=post) for name, (kind, post) in _POSTS.items()},
)

_UNKNOWN_ASSET = AssetSpec(kind="uav", post="Checkpoint")
"""The specification of an asset that exists only in an example."""

CHANGES = ("at", "tracks", "covered", "up", "orders")
STEP_S = 1.0
_UNKNOWN: Values = {
    "identity": "unknown",
    "intent": "unknown",
    "status": "approaching",
    "observed": False,
    "warned": False,
}
GIVEN = ("assets", "tracks", "gates", "after", "timeline", "sightings")
MISSION_TEXT = "Secure the checkpoint."

_SIGHTINGS: TypeAdapter[list[TrackSighting]] = TypeAdapter(list[TrackSighting])


def situation(given: Values, world: World = WORLD) -> Values:
    """Return the picture of the `given` assets, tracks and gates as plain values.

    `available`, `low_battery` and the cover of each gate follow from the assets unless `given` has
    them. A track needs only its gate.
    """
    picture: Values = {"tick": 0, "time_s": 100.0, "assets": {}, "tracks": {}, "gates": {}}
    assets: Values = given.get("assets", {})
    tracks: Values = given.get("tracks", {})
    for name in dict.fromkeys((*world.assets, *assets)):
        picture["assets"][name] = _asset(world, name, assets.get(name, {}))
    for name, facts in tracks.items():
        picture["tracks"][name] = _track(world, name, facts)
    picture["gates"] = overlay(covers(picture, world), given.get("gates", {}))
    return picture


def covers(picture: Values, world: World) -> Values:
    """Return the cover of each gate: every available asset that is at its post there."""
    watch = {
        gate: [
            name
            for name, asset in picture["assets"].items()
            if asset["available"] and asset["post"] == asset["at"] == gate
        ]
        for gate in world.gates
    }
    return {gate: {"covered": bool(names), "by": names} for gate, names in watch.items()}


def carried_out(before: Values, plan: Plan, world: World) -> Values:
    """Return the picture after all actions of the plan that are possible."""
    after = copy.deepcopy(before)
    after["time_s"] += DURATION_S
    for action in plan.actions:
        asset = after["assets"].get(action.agent)
        frame = goes_to(action, world)
        if asset is not None and asset["available"] and frame in world.frames:
            asset.update(at=frame, post=frame, position=world.frames[frame].at)
    after["gates"] = covers(after, world)
    return after


def example_timeline(before: Values, after: Values, plan: Plan, world: World) -> Values:
    """Return the timeline of a plan: UAVs arrive after RECON_S, others after CONTACT_S."""
    lost = {gate for gate in world.gates if not after["gates"][gate]["covered"]}
    return {
        "duration_s": DURATION_S,
        "gates": {
            gate: {
                "covered_before": before["gates"][gate]["covered"],
                "covered_after": gate not in lost,
                "longest_gap_s": DURATION_S if gate in lost else 0.0,
            }
            for gate in world.gates
        },
        "tracks": {name: _contacts(track, plan, world) for name, track in before["tracks"].items()},
        "assets": {
            action.agent: _outcome(action, before, world)
            for action in plan.actions
            if action.agent in before["assets"]
        },
    }


def overlay(base: Values, over: Values) -> Values:
    """Return `base` with the values of `over` on top; mappings are merged at every depth."""
    merged = dict(base)
    for key, value in over.items():
        below = merged.get(key)
        if isinstance(below, dict) and isinstance(value, dict):
            merged[key] = overlay(cast("Values", below), cast("Values", value))
        else:
            merged[key] = value
    return merged


def _asset(world: World, name: str, facts: Values) -> Values:
    spec = world.assets.get(name, _UNKNOWN_ASSET)
    asset: Values = {
        "id": name, "kind": spec.kind, "at": spec.post, "post": spec.post, "heading_deg": 0.0,
        "speed_mps": 0.0, "status": "ok", "task": "idle", "battery_pct": 90.0, "comms": "ok",
        "stamp_s": 100.0,
    } | facts  # fmt: skip
    if "post" not in facts:
        asset["post"] = asset["at"]
    frame = world.frames.get(asset["at"] or "")
    charge = asset["battery_pct"]
    derived: Values = {
        "position": frame.at if frame is not None else (0.0, 0.0),
        "low_battery": charge < world.low_battery_pct,
        "available": asset["status"] != "failed" and asset["comms"] != "lost" and charge > 0,
    }
    return derived | asset


def _track(world: World, name: str, facts: Values) -> Values:
    gate = world.frames.get(facts.get("gate", ""))
    return {
        "id": name, "kind": "vehicle", "position": _outside(gate.at if gate else (0.0, 50.0)),
        "heading_deg": 0.0, "speed_mps": 5.0, "distance_m": TRACK_DISTANCE_M, "stamp_s": 100.0,
    } | facts  # fmt: skip


def _outside(gate: Point) -> Point:
    """Return the position TRACK_DISTANCE_M outside `gate`, away from the centre."""
    stretch = 1.0 + TRACK_DISTANCE_M / max(math.hypot(*gate), 1.0)
    return (gate[0] * stretch, gate[1] * stretch)


def _contacts(track: Values, plan: Plan, world: World) -> Values:
    kinds = {
        world.assets[action.agent].kind
        for action in plan.actions
        if action.agent in world.assets and goes_to(action, world) == track["gate"]
    }
    seen = 0.0 if track.get("observed") else RECON_S if "uav" in kinds else None
    return {"observed_s": seen, "ground_contact_s": CONTACT_S if kinds - {"uav"} else None}


def _outcome(action: Action, before: Values, world: World) -> Values:
    asset, frame = before["assets"][action.agent], goes_to(action, world)
    occupied = any(track["gate"] == frame for track in before["tracks"].values())
    detail = ""
    if not asset["available"]:
        detail = f"{action.agent} is not available"
    elif frame and frame not in world.frames:
        detail = f"no frame {frame}"
    elif action.verb in ADDRESSING and not occupied:
        detail = f"no track at {frame}"
    return {"finished": not detail, "detail": detail, "least_battery_pct": asset["battery_pct"]}


def run_moments(entry: CompiledRule, example: RuleExample) -> Finding:
    """Return the finding of the orderings of `entry` for the moments of `example` and their end.

    Raises the errors of `example_moments`.
    """
    monitor = Monitor(Rulebook("example", "", (entry,)), WORLD)
    findings = [new for now in example_moments(example) for new in monitor.observe(now)]
    findings += monitor.finish()
    return findings[0] if findings else finding(entry.rule, "complies")


def example_moments(example: RuleExample) -> tuple[Moment, ...]:
    """Return the moments of `example`.

    Raises ValueError for an unknown key, ValidationError for an impossible fact.
    """
    state: Values = {"time_s": -STEP_S, "covered": dict.fromkeys(WORLD.gates, True), "tracks": {}}
    moments: list[Moment] = []
    for number, change in enumerate(example.moments):
        unknown = sorted(set(change) - set(CHANGES))
        if unknown:
            choices = ", ".join(CHANGES)
            raise ValueError(f"moments.{number}.{unknown[0]} is unknown; known: {choices}")
        state = _changed(state, change)
        moments.append(Moment.model_validate_json(json.dumps(state)))
    return tuple(moments)


def _changed(state: Values, change: Values) -> Values:
    named: Values = change.get("tracks", {})
    states: Values = state["tracks"]
    tracks = states | {
        name: overlay(states.get(name) or _UNKNOWN, facts)
        for name, facts in named.items()
        if facts is not None
    }
    after: Values = {
        "time_s": change.get("at", state["time_s"] + STEP_S),
        "tracks": {n: t for n, t in tracks.items() if n not in named or named[n] is not None},
        "covered": state["covered"] | change.get("covered", {}),
        "up": state.get("up", {}) | change.get("up", {}),
        "orders": state.get("orders", []),
    }
    if "orders" in change:
        after["orders"] = [_order(order) for order in change["orders"]]
    return after


def _order(words: Iterable[object]) -> Values:
    agent, command, *rest = cast("list[str]", list(words))
    action = Action(agent=agent, command=command)
    kind = WORLD.assets[agent].kind
    target, done = action.target, rest == ["done"]
    return {"agent": agent, "kind": kind, "verb": action.verb, "target": target, "done": done}


def run_example(rule: Rule, example: RuleExample) -> Finding:
    """Return the finding of `rule`, by its check or its orderings, for `example`.

    An inconsistent example, or a check that does not compile, gives a finding with status error.
    """
    try:
        entry = compile_rule(rule)
        if example.moments:
            return run_moments(entry, example)
        plan = example_plan(example)
        rehearsal = example_rehearsal(example, plan)
        sightings = example_sightings(example, rehearsal.before.time_s)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(str(part) for part in first["loc"])
        return _wrong(rule, f"{place}: {first['msg']}")
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        return _wrong(rule, f"{type(error).__name__}: {error}")
    mission = Mission(
        id="example", text=example.mission or MISSION_TEXT, created=datetime(2000, 1, 1, tzinfo=UTC)
    )
    return check_rule(
        entry, plan=plan, rehearsal=rehearsal, mission=mission, world=WORLD, sightings=sightings
    )


def example_plan(example: RuleExample) -> Plan:
    """Return the plan of `example`; raises ValidationError if it is not well-formed."""
    actions = [{"agent": agent, "command": command} for agent, command in example.plan]
    return Plan.model_validate_json(json.dumps({"reason": example.reason, "actions": actions}))


def example_rehearsal(example: RuleExample, plan: Plan) -> Rehearsal:
    """Return the situation of `example` and the consequences of its plan.

    Raises ValueError for an unknown key of `given`, ValidationError for an impossible fact.
    """
    given = example.given
    unknown = sorted(set(given) - set(GIVEN))
    if unknown:
        raise ValueError(f"given.{unknown[0]} is unknown; known: {', '.join(GIVEN)}")
    return rehearsal_in(WORLD, given, plan)


def rehearsal_in(world: World, given: Values, plan: Plan) -> Rehearsal:
    """Return the `given` situation in `world` and the consequences of `plan` in it.

    Raises ValidationError for an impossible fact.
    """
    before = situation(given, world)
    after = overlay(carried_out(before, plan, world), given.get("after", {}))
    timeline = overlay(example_timeline(before, after, plan, world), given.get("timeline", {}))
    values: dict[str, Any] = {"before": before, "after": after, "timeline": timeline}
    return Rehearsal.model_validate_json(json.dumps(values))


def example_sightings(example: RuleExample, now_s: float) -> Sightings:
    """Return the sightings before the plan of `example`; `now_s` is the time of its picture.

    Raises TypeError for entries that are not mappings, ValidationError for an impossible fact.
    """
    facts: list[Any] = []
    for entry in example.given.get("sightings", ()):
        age_s: float = entry.get("age_s", 0.0)
        fields = {key: value for key, value in entry.items() if key != "age_s"}
        facts.append({"gate": "", "stamp_s": now_s - age_s} | fields)
    return Sightings(WORLD, _SIGHTINGS.validate_python(facts))


def _wrong(rule: Rule, problem: str) -> Finding:
    return Finding(
        rule_id=rule.id,
        priority=rule.priority,
        status="error",
        message=f"the example cannot be run: {problem}",
    )
