"""Size changes nothing: what is decided at a large checkpoint is what a small one would get."""

import json
import math
from datetime import UTC, datetime
from typing import Any

import pytest

from pa_console.policy.expressions.expression import PLAN_VARIABLES
from pa_console.policy.rule_checks import check_plan
from pa_console.policy.rule_variables import plan_variables
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.world import AssetKind, AssetSpec, Frame, Platform, World
from tests.policy.book import checkpoint_rules

MISSION = Mission(id="M1", text="Identify it.", created=datetime(2026, 1, 1, tzinfo=UTC))


@pytest.mark.parametrize(("assets", "gates", "tracks"), [(30, 4, 2), (1000, 50, 50)])
def test_every_rule_is_decided_alike_at_any_size(assets: int, gates: int, tracks: int) -> None:
    world = large_world(assets, gates)
    plan = large_plan(world)
    rehearsal = large_rehearsal(world, plan, tracks=tracks, moments=20)
    findings = check_plan(
        checkpoint_rules(), plan=plan, rehearsal=rehearsal, mission=MISSION, world=world
    )
    assert {f.rule_id for f in findings if f.broken} == {"WF-02"}
    assert not any(finding.status == "error" for finding in findings)


def test_only_what_is_asked_for_is_converted_and_it_is_the_same_then() -> None:
    world = large_world(12, 4)
    plan = large_plan(world)
    rehearsal = large_rehearsal(world, plan, tracks=3, moments=0)
    whole = plan_variables(plan, rehearsal, MISSION, world)
    assert set(whole) == PLAN_VARIABLES
    for name in PLAN_VARIABLES:
        assert plan_variables(plan, rehearsal, MISSION, world, {name: None}) == {name: whole[name]}


KINDS: tuple[AssetKind, ...] = ("uav", "ugv", "robot")
PLATFORM = Platform(
    speed_mps=5.0,
    turn_rate_dps=90.0,
    radius_m=1.0,
    sensor_range_m=30.0,
    drain_idle_pct_per_min=0.1,
    drain_moving_pct_per_min=1.0,
)


def large_world(assets: int, gates: int) -> World:
    """Return a round world; the assets are spread over the gates, kind after kind."""
    frames = {
        f"Gate_{n}": Frame(
            kind="gate",
            at=(500 * math.cos(math.tau * n / gates), 500 * math.sin(math.tau * n / gates)),
        )
        for n in range(gates)
    }
    places = [*frames, "Checkpoint"]
    return World(
        name="large",
        title="A large checkpoint",
        standoff_m=10.0,
        coverage_grace_s=15.0,
        perimeter=((-600.0, -600.0), (600.0, -600.0), (600.0, 600.0), (-600.0, 600.0)),
        frames=frames
        | {
            "Checkpoint": Frame(kind="post", at=(0.0, 0.0)),
            "Base": Frame(kind="base", at=(-30.0, -30.0)),
        },
        platforms=dict.fromkeys(KINDS, PLATFORM),
        assets={
            f"Asset_{n}": AssetSpec(kind=KINDS[n % 3], post=places[n % len(places)])
            for n in range(assets)
        },
    )


def large_plan(world: World) -> Plan:
    """Return a plan that sends a UAV and a robot to the first gate and some others around."""
    uavs = [name for name, spec in world.assets.items() if spec.kind == "uav"]
    robots = [name for name, spec in world.assets.items() if spec.kind == "robot"]
    gates = world.gates
    orders = [(uavs[-1], f"observe {gates[0]}"), (robots[-1], f"identify {gates[0]}")]
    orders += [(name, f"move_to {gates[n % len(gates)]}") for n, name in enumerate(uavs[:6])]
    actions = [{"agent": agent, "command": command} for agent, command in dict(orders).items()]
    return Plan.model_validate_json(json.dumps({"reason": "recon first", "actions": actions}))


def large_rehearsal(world: World, plan: Plan, *, tracks: int, moments: int) -> Rehearsal:
    """Return what `plan` might bring about, with `tracks` unknown vehicles and their moments.

    One gate or none is uncovered at each moment, and every one is covered again by the end.
    """
    gates = world.gates
    by = {gate: [n for n, spec in world.assets.items() if spec.post == gate] for gate in gates}
    picture: dict[str, Any] = {
        "tick": 0,
        "time_s": 100.0,
        "assets": {
            name: {
                "id": name, "kind": spec.kind, "at": spec.post, "post": spec.post,
                "position": world.frames[spec.post].at, "heading_deg": 0.0, "speed_mps": 0.0,
                "status": "ok", "task": "idle", "battery_pct": 90.0, "low_battery": False,
                "comms": "ok", "available": True, "stamp_s": 100.0,
            }
            for name, spec in world.assets.items()
        },
        "tracks": {
            f"Track_{n}": {
                "id": f"Track_{n}", "kind": "vehicle", "gate": gates[n % len(gates)],
                "position": (0.0, 0.0), "heading_deg": 0.0, "speed_mps": 5.0, "distance_m": 40.0,
                "stamp_s": 100.0,
            }
            for n in range(tracks)
        },
        "gates": {gate: {"covered": bool(by[gate]), "by": by[gate]} for gate in gates},
    }  # fmt: skip
    seen = {"identity": "unknown", "intent": "unknown", "status": "approaching", "warned": False}
    states = [
        {
            "time_s": 100.0 + 0.5 * number,
            "tracks": {
                name: {"gate": track["gate"], "observed": number > n, **seen}
                for n, (name, track) in enumerate(picture["tracks"].items())
            },
            "covered": {
                gate: bool(by[gate]) and (number % 7 != n or number == moments - 1)
                for n, gate in enumerate(gates)
            },
        }
        for number in range(moments)
    ]
    cover = {
        g: {"covered_before": True, "covered_after": True, "longest_gap_s": 0.0} for g in gates
    }
    values: dict[str, Any] = {
        "before": picture,
        "after": picture | {"time_s": 160.0},
        "timeline": {
            "duration_s": 60.0,
            "gates": cover,
            "tracks": {name: {} for name in picture["tracks"]},
            "assets": {action.agent: {"finished": True} for action in plan.actions},
        },
        "moments": states,
    }
    return Rehearsal.model_validate_json(json.dumps(values))
