"""Generated checkpoint worlds of any size; shape, names and team follow from a seed."""

import math
import random
from collections.abc import Sequence

import yaml

from pa_console.schema.world import (
    AssetKind,
    AssetSpec,
    Camera,
    Frame,
    Lane,
    Platform,
    Wall,
    World,
    Zone,
)
from pa_console.sim.worlds import generated_ground as names
from pa_console.sim.worlds.generated_ground import GATE_RADIUS_M, STANDOFF_M, GateSite, lay_out

MOST_GATES = names.MOST_GATES
MOST_ASSETS = 2000
_PLATFORMS: dict[AssetKind, Platform] = {
    "uav": Platform(
        speed_mps=12.0,
        turn_rate_dps=120.0,
        radius_m=0.6,
        sensor_range_m=60.0,
        drain_idle_pct_per_min=2.5,
        drain_moving_pct_per_min=3.5,
    ),
    "ugv": Platform(
        speed_mps=4.0,
        turn_rate_dps=90.0,
        radius_m=1.2,
        sensor_range_m=30.0,
        drain_idle_pct_per_min=0.2,
        drain_moving_pct_per_min=1.2,
    ),
    "robot": Platform(
        speed_mps=2.0,
        turn_rate_dps=120.0,
        radius_m=0.5,
        sensor_range_m=25.0,
        drain_idle_pct_per_min=0.3,
        drain_moving_pct_per_min=1.5,
    ),
}


def generate_world(gates: int, assets: int, seed: int) -> World:
    """Return a valid world with this many gates and assets; equal arguments give equal worlds.

    Every gate has an asset posted to it if the team is large enough. Raises ValueError for numbers
    out of range.
    """
    for noun, count, most in (("gates", gates, MOST_GATES), ("assets", assets, MOST_ASSETS)):
        if not 1 <= count <= most:
            raise ValueError(f"{noun}: {count} is out of range; it must be from 1 to {most}")
    rng = random.Random(f"world/{gates}/{assets}/{seed}")
    post_names = names.posts(rng, min(names.MOST_POSTS, 1 + gates // 10))
    ground = lay_out(rng, gates, assets, len(post_names))
    sites = dict(zip(names.gates(rng, gates), ground.gates, strict=True))
    base = names.base(rng)
    frames = {
        gate: Frame(kind="gate", at=site.at, radius_m=GATE_RADIUS_M) for gate, site in sites.items()
    }
    for post, (at, radius) in zip(post_names, ground.posts, strict=True):
        frames[post] = Frame(kind="post", at=at, radius_m=radius)
    frames[base] = Frame(kind="base", at=ground.base[0], radius_m=ground.base[1])
    zones = zip(names.zones(rng, len(ground.zones)), ground.zones, strict=True)
    return World(
        name=f"generated_g{gates}_a{assets}_s{seed}".replace("-", "m"),
        title=f"Generated checkpoint: {gates} gates, {assets} assets, seed {seed}",
        standoff_m=STANDOFF_M,
        coverage_grace_s=max(20.0, round(_size(ground.perimeter) / 8.0)),
        perimeter=ground.perimeter,
        walls=(
            *(Wall(start=a, end=b) for a, b in ground.walls),
            *(Wall(start=a, end=b, thickness_m=0.8) for a, b in ground.barriers),
        ),
        frames=frames,
        lanes={_named(gate, "Lane"): Lane(gate=gate, points=s.lane) for gate, s in sites.items()},
        zones={name: Zone(kind="restricted", polygon=polygon) for name, polygon in zones},
        cameras={_named(gate, "Camera"): _camera(gate, site) for gate, site in sites.items()},
        platforms={kind: _varied(rng, platform) for kind, platform in _PLATFORMS.items()},
        assets=_team(rng, assets, list(sites), post_names, base),
    )


def world_yaml(world: World) -> str:
    """Return `world` as the text of a world file; reading it gives an equal world."""
    document = world.model_dump(mode="json", exclude_defaults=True)
    text = yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=100)
    return f"# {world.title}. Metres, x east, y north.\n{text}"


def _team(
    rng: random.Random, count: int, gates: Sequence[str], posts: Sequence[str], base: str
) -> dict[str, AssetSpec]:
    """Return the assets: first one for each gate, then others at places that always have room."""
    words = names.team(rng)
    weights = [rng.uniform(0.8, 1.6), rng.uniform(0.5, 1.2), rng.uniform(0.5, 1.2)]
    every: tuple[AssetKind, ...] = ("uav", "ugv", "robot")
    kinds = [*every[:count], *rng.choices(every, weights, k=max(0, count - len(every)))]
    rng.shuffle(kinds)
    roomy = (posts[0], posts[0], base)
    where = [*rng.sample(gates, len(gates)), *rng.sample(gates, len(gates) // 2)]
    where = [*where, *(rng.choice(roomy) for _ in range(count))][:count]
    team: dict[str, AssetSpec] = {}
    for kind in every:
        posted = [at for at, kind_at in zip(where, kinds, strict=True) if kind_at == kind]
        for number, post in enumerate(posted, start=1):
            team[f"{words[kind]}_T{number:02d}"] = AssetSpec(kind=kind, post=post)
    return team


def _camera(gate: str, site: GateSite) -> Camera:
    """Return a camera outside the wall, beside the opening, that looks along the lane."""
    (ox, oy), (nx, ny) = site.opening, site.outward
    at = (round(ox + 1.5 * nx - 4.0 * ny, 2), round(oy + 1.5 * ny + 4.0 * nx, 2))
    middle = site.lane[-2]
    heading = math.degrees(math.atan2(middle[1] - at[1], middle[0] - at[0]))
    return Camera(
        gate=gate,
        at=at,
        heading_deg=round(heading, 1),
        sensor_range_m=50.0,
        field_of_view_deg=90.0,
        detection_probability=0.9,
        position_noise_m=1.0,
    )


def _varied(rng: random.Random, platform: Platform) -> Platform:
    """Return `platform` with a slightly different speed."""
    speed = round(platform.speed_mps * rng.uniform(0.85, 1.2), 1)
    return platform.model_copy(update={"speed_mps": speed})


def _named(gate: str, suffix: str) -> str:
    return gate.removesuffix("Gate") + suffix


def _size(points: Sequence[tuple[float, float]]) -> float:
    """Return the length in metres of the longer side of the bounding box of `points`."""
    xs, ys = [x for x, _ in points], [y for _, y in points]
    return max(max(xs) - min(xs), max(ys) - min(ys))
