"""A large checkpoint and its picture, built by hand for tests of selection."""

import math
from collections.abc import Mapping

from pa_console.schema.telemetry import AssetTelemetry, GateCover, Picture, Track
from pa_console.schema.world import AssetKind, AssetSpec, Frame, Platform, World
from tests.mission.pictures import asset

PLATFORM = Platform(
    speed_mps=5.0, turn_rate_dps=90.0, radius_m=0.5, sensor_range_m=40.0,
    drain_idle_pct_per_min=0.1, drain_moving_pct_per_min=1.0,
)  # fmt: skip
PLACES = ("River", "Hill", "Mill", "Dock", "Quarry", "Orchard", "Chapel", "Foundry", "Ferry", "Oak")
KINDS: tuple[AssetKind, ...] = ("uav", "ugv", "robot")


def large_world(gates: int = 50, assets: int = 1000) -> World:
    """Return a world whose gates stand on a circle of 1 km, each with one asset, the rest spare."""
    names = [f"{PLACES[n % 10]}Gate_{n // 10 + 1}" for n in range(gates)]
    frames = {
        name: Frame(kind="gate", at=_on_circle(n, gates, 1000.0)) for n, name in enumerate(names)
    }
    frames["Yard"] = Frame(kind="post", at=(10.0, 0.0))
    frames["Depot"] = Frame(kind="base", at=(0.0, 0.0))
    posts = [*names, *("Yard" for _ in range(assets - gates))][:assets]
    return World(
        name="large",
        title="Large",
        standoff_m=10.0,
        coverage_grace_s=20.0,
        perimeter=((-1e3, -1e3), (1e3, -1e3), (0.0, 1e3)),
        frames=frames,
        platforms=dict.fromkeys(KINDS, PLATFORM),
        assets={
            f"Unit_{n:04d}": AssetSpec(kind=KINDS[n % 3], post=post) for n, post in enumerate(posts)
        },
    )


def _on_circle(number: int, count: int, radius: float) -> tuple[float, float]:
    angle = math.tau * number / count
    return round(radius * math.cos(angle), 1), round(radius * math.sin(angle), 1)


def calm(world: World, *tracks: Track, **changes: Mapping[str, object]) -> Picture:
    """Return the picture of everybody at their posts, but for `changes` by asset id."""
    team: dict[str, AssetTelemetry] = {}
    for name, spec in world.assets.items():
        told = asset(name, spec.kind, spec.post, position=world.frames[spec.post].at)
        team[name] = told.model_copy(update=changes.get(name, {}))
    gates: dict[str, GateCover] = {}
    for gate in world.gates:
        here = [a for a in team.values() if a.at == a.post == gate]
        by = tuple(a.id for a in here if a.available)
        unsure = tuple(a.id for a in here if not a.available and a.stale)
        gates[gate] = GateCover(covered=bool(by), by=by, unsure=unsure)
    return Picture(
        tick=100, time_s=10.0, assets=team, tracks={t.id: t for t in tracks}, gates=gates
    )
