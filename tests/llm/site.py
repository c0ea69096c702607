"""A small checkpoint, built by hand, that the tests of prompts and grammars share."""

from datetime import UTC, datetime

from pa_console.schema.mission import Mission
from pa_console.schema.rule import Rule
from pa_console.schema.telemetry import AssetTelemetry, Digest, GateCover, Picture
from pa_console.schema.world import AssetKind, AssetSpec, Frame, Platform, World

PLATFORM = Platform(
    speed_mps=5.0,
    turn_rate_dps=90.0,
    radius_m=0.5,
    sensor_range_m=40.0,
    drain_idle_pct_per_min=0.1,
    drain_moving_pct_per_min=1.0,
)
KINDS: dict[str, AssetKind] = {
    "Hawk_1": "uav",
    "Hawk_2": "uav",
    "Mule_1": "ugv",
    "Guard_1": "robot",
}
WORLD = World(
    name="yard",
    title="A yard",
    standoff_m=10.0,
    coverage_grace_s=5.0,
    perimeter=((0.0, 0.0), (10.0, 0.0), (10.0, 10.0)),
    frames={
        "RiverGate": Frame(kind="gate", at=(0.0, 0.0)),
        "HillGate": Frame(kind="gate", at=(10.0, 0.0)),
        "Depot": Frame(kind="base", at=(5.0, 5.0)),
    },
    platforms={"uav": PLATFORM, "ugv": PLATFORM, "robot": PLATFORM},
    assets={name: AssetSpec(kind=kind, post="Depot") for name, kind in KINDS.items()},
)


def telemetry(name: str, *, available: bool = True) -> AssetTelemetry:
    return AssetTelemetry(
        id=name,
        kind=KINDS[name],
        at="Depot",
        post="Depot",
        position=(5.0, 5.0),
        heading_deg=0.0,
        speed_mps=0.0,
        status="ok" if available else "failed",
        task="idle",
        battery_pct=90.0,
        low_battery=False,
        comms="ok",
        available=available,
        stamp_s=0.0,
    )


def picture(down: tuple[str, ...] = ()) -> Picture:
    return Picture(
        tick=0,
        time_s=0.0,
        assets={name: telemetry(name, available=name not in down) for name in KINDS},
        gates={gate: GateCover(covered=False) for gate in WORLD.gates},
    )


def mission(text: str) -> Mission:
    return Mission(id="m1", text=text, created=datetime(2026, 1, 1, tzinfo=UTC))


DIGEST = Digest(
    covered={"RiverGate": 1, "HillGate": 0},
    uncovered=("HillGate",),
    free={"uav": ("Hawk_2",), "ugv": ("Mule_1",), "robot": ("Guard_1",)},
    sole_cover={"RiverGate": "Hawk_1"},
    posts={"Hawk_1": "uav at RiverGate", "Hawk_2": "uav at Depot"},
    down=(),
    low_battery=(),
    tracks=(),
)
RULE = Rule(id="WF-99", domain="WF", priority="high", text="Keep every gate covered.")
