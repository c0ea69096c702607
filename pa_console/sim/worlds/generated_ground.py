"""The ground of a generated world, and the names of its parts."""

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass

import shapely
from shapely.geometry import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from pa_console.schema.base import Point
from pa_console.schema.world import AssetKind

_GATE_WORDS = """
Abbey Airfield Anchor Ash Barn Bay Beacon Bell Birch Bridge Brook Canal Castle Cedar Chapel Cliff
Coal Copper Creek Dock Dune Eagle Elm Falcon Farm Ferry Field Ford Forest Forge Foundry Fox
Garden Garrison Glen Granite Grove Harbor Harvest Hawthorn Heath Heron Highland Hill Iron Island
Kiln Lagoon Lake Larch Lighthouse Lime Lock Maple Market Marsh Meadow Mill Moor Oak Ocean Orchard
Pasture Pier Pine Pond Poplar Port Prairie Quarry Rail Ridge River Sand Shore Silver Slate
Spring Station Stone Summit Sunset Thistle Timber Tower Tunnel Valley Viaduct Village Vineyard
Walnut Warehouse Water Wharf Willow Wind Wolf
"""
_POSTS = (
    "Checkpoint", "Plaza", "Crossroads", "ControlPoint", "Yard", "Courtyard", "Hub", "Rotunda",
    "InspectionArea", "Square", "Terrace", "Junction",
)  # fmt: skip
_BASES = ("Base", "Depot", "Hangar", "Garage", "MotorPool", "Barracks")
_ZONES = ("Magazine", "FuelStore", "Substation", "Laboratory", "Vault", "Archive")
_TEAMS: tuple[dict[AssetKind, str], ...] = (
    {"uav": "Drone", "ugv": "Ugv", "robot": "Robot"},
    {"uav": "Uav", "ugv": "Rover", "robot": "Walker"},
    {"uav": "Kestrel", "ugv": "Mule", "robot": "Sentry"},
    {"uav": "Quad", "ugv": "Truck", "robot": "Guard"},
    {"uav": "Skyeye", "ugv": "Bulwark", "robot": "Warden"},
)
STANDOFF_M = 10.0
GATE_RADIUS_M = 8.0
_INSIDE_M = 7.0
_OPENING_M = 12.0
_PITCH_M = 30.0
_CORNER_M = 24.0
_LANE_M = 95.0
_LEAST_LANE_M = 50.0
_LANE_CLEAR_M = 12.0
_PLACE_M2 = 11.0
"""The ground that one standing place in a frame takes, in square metres."""
_CLEAR_M = 9.0
_TRIES = 400
MOST_GATES = len(_GATE_WORDS.split())
MOST_POSTS = len(_POSTS)


def outline(rng: random.Random) -> list[Point]:
    """Return a rectangle, an L, a T or a convex polygon with many sides."""
    return rng.choice((_rectangle, _ell, _tee, _polygon))(rng)


def scaled(points: Sequence[Point], size_m: float) -> tuple[Point, ...]:
    """Return `points` scaled to `size_m` metres per unit, rounded to the decimetre."""
    return tuple((round(x * size_m, 1), round(y * size_m, 1)) for x, y in points)


def ellipse(rng: random.Random, sides: int, a: float, b: float) -> list[Point]:
    """Return a convex polygon with its corners on an ellipse with semi-axes `a` and `b`."""
    turn = rng.uniform(0.0, math.tau)
    angles = [turn + (k + rng.uniform(-0.2, 0.2)) * math.tau / sides for k in range(sides)]
    return [(a * math.cos(angle), b * math.sin(angle)) for angle in angles]


def _rectangle(rng: random.Random) -> list[Point]:
    x, y = rng.uniform(0.5, 0.8), rng.uniform(0.35, 0.6)
    return [(-x, -y), (x, -y), (x, y), (-x, y)]


def _ell(rng: random.Random) -> list[Point]:
    """Return an L, with its notch at the upper right, or its mirror image."""
    x, y = rng.uniform(0.6, 0.8), rng.uniform(0.5, 0.7)
    notch_x, notch_y = x * rng.uniform(-0.1, 0.3), y * rng.uniform(-0.1, 0.3)
    points = [(-x, -y), (x, -y), (x, notch_y), (notch_x, notch_y), (notch_x, y), (-x, y)]
    return _mirrored(points) if rng.random() < 0.5 else points


def _tee(rng: random.Random) -> list[Point]:
    x, y = rng.uniform(0.7, 0.9), rng.uniform(0.55, 0.7)
    stem, bar = x * rng.uniform(0.45, 0.6), y * rng.uniform(-0.1, 0.2)
    return [
        (-stem, -y), (stem, -y), (stem, bar), (x, bar), (x, y), (-x, y), (-x, bar), (-stem, bar),
    ]  # fmt: skip


def _polygon(rng: random.Random) -> list[Point]:
    return ellipse(rng, rng.randint(5, 12), rng.uniform(0.65, 0.85), rng.uniform(0.5, 0.7))


def _mirrored(points: Sequence[Point]) -> list[Point]:
    return [(-x, y) for x, y in reversed(points)]


def gates(rng: random.Random, count: int) -> list[str]:
    """Return `count` different names of gates."""
    return [f"{word}Gate" for word in rng.sample(_GATE_WORDS.split(), count)]


def posts(rng: random.Random, count: int) -> list[str]:
    """Return `count` different names of posts."""
    return rng.sample(_POSTS, count)


def base(rng: random.Random) -> str:
    """Return the name of a base."""
    return rng.choice(_BASES)


def zones(rng: random.Random, count: int) -> list[str]:
    """Return `count` different names of restricted zones."""
    return rng.sample(_ZONES, count)


def team(rng: random.Random) -> dict[AssetKind, str]:
    """Return, for each kind of asset, the part of an asset's name before `_Tnn`."""
    return rng.choice(_TEAMS)


@dataclass(frozen=True, slots=True)
class GateSite:
    """A gate's place: its frame, the centre of its opening, the outward direction, its lane."""

    at: Point
    opening: Point
    outward: Point
    lane: tuple[Point, ...]


@dataclass(frozen=True, slots=True)
class GeneratedGround:
    """All parts of a generated world that have a position; circles are (centre, radius)."""

    perimeter: tuple[Point, ...]
    gates: tuple[GateSite, ...]
    walls: tuple[tuple[Point, Point], ...]
    posts: tuple[tuple[Point, float], ...]
    base: tuple[Point, float]
    zones: tuple[tuple[Point, ...], ...]
    barriers: tuple[tuple[Point, Point], ...]


def lay_out(rng: random.Random, gates: int, assets: int, posts: int) -> GeneratedGround:
    """Return ground that is large enough for the given numbers of gates, assets and posts."""
    the_outline = outline(rng)
    room = math.sqrt(assets * _PLACE_M2 / math.pi) + 3.0
    radii = [max(9.0, room), *[9.0] * (posts - 1)]
    size = max(80.0, gates * _PITCH_M / 4.0, 5.0 * room)
    while True:
        perimeter = scaled(the_outline, size)
        sites = _sites(rng, perimeter)
        if len(sites) >= gates:
            chosen = sorted(rng.sample(range(len(sites)), gates))
            kept = tuple(sites[index] for index in chosen)
            circles = _circles(rng, perimeter, kept, [max(8.0, room), *radii])
            if circles is not None:
                break
        size *= 1.15
    base, *places = circles
    taken: list[BaseGeometry] = [shapely.Point(at).buffer(radius) for at, radius in circles]
    taken += [shapely.Point(site.at).buffer(GATE_RADIUS_M) for site in kept]
    inner = Polygon(perimeter).buffer(-_CLEAR_M)
    zones = _zones(rng, inner, taken, rng.randint(1, 2))
    taken += [Polygon(zone) for zone in zones]
    return GeneratedGround(
        perimeter=perimeter,
        gates=kept,
        walls=tuple(_walls(perimeter, kept)),
        posts=tuple(places),
        base=base,
        zones=zones,
        barriers=_barriers(rng, inner, taken, min(40, 3 + gates)),
    )


def _sites(rng: random.Random, perimeter: Sequence[Point]) -> list[GateSite]:
    """Return places for gates along the perimeter, each with a lane clear of other gates' lanes."""
    polygon = Polygon(perimeter)
    sites: list[GateSite] = []
    lanes: list[LineString] = []
    for start, end in zip(perimeter, (*perimeter[1:], perimeter[0]), strict=True):
        length = math.dist(start, end)
        count = int((length - 2 * _CORNER_M) / _PITCH_M) + 1 if length >= 2 * _CORNER_M else 0
        spare = length - 2 * _CORNER_M - (count - 1) * _PITCH_M
        along = ((end[0] - start[0]) / length, (end[1] - start[1]) / length)
        for index in range(count):
            offset = _CORNER_M + spare / 2 + index * _PITCH_M
            opening = (start[0] + along[0] * offset, start[1] + along[1] * offset)
            site = _site(rng, polygon, opening, (along[1], -along[0]))
            lane = LineString(site.lane) if site is not None else None
            if site is None or lane is None or any(lane.distance(o) < _LANE_CLEAR_M for o in lanes):
                continue
            sites.append(site)
            lanes.append(lane)
    return sites


def _site(rng: random.Random, polygon: Polygon, opening: Point, outward: Point) -> GateSite | None:
    """Return the gate at `opening`, or None if there is no room for its lane outside."""

    def ahead(metres: float, aside: float = 0.0) -> Point:
        x = opening[0] + outward[0] * metres - outward[1] * aside
        y = opening[1] + outward[1] * metres + outward[0] * aside
        return _rounded((x, y))

    near, middle = ahead(2.5), ahead(_LEAST_LANE_M)
    far = ahead(_LANE_M, rng.uniform(-18.0, 18.0))
    for points in ((far, middle, near), (ahead(_LEAST_LANE_M + 15.0), near), (middle, near)):
        beyond = LineString([*points[:-1], ahead(8.0)])
        if polygon.distance(beyond) > 7.5:
            at = ahead(-_INSIDE_M)
            return GateSite(at=at, opening=_rounded(opening), outward=outward, lane=points)
    return None


def _walls(perimeter: Sequence[Point], sites: Sequence[GateSite]) -> list[tuple[Point, Point]]:
    """Return the perimeter's walls, with an opening at every gate."""
    walls: list[tuple[Point, Point]] = []
    for start, end in zip(perimeter, (*perimeter[1:], perimeter[0]), strict=True):
        side = LineString((start, end))
        marks = sorted(
            side.project(shapely.Point(site.opening))
            for site in sites
            if side.distance(shapely.Point(site.opening)) < 0.1
        )
        here = start
        for mark in marks:
            before, after = (side.interpolate(mark + d) for d in (-_OPENING_M / 2, _OPENING_M / 2))
            walls.append((here, _rounded((before.x, before.y))))
            here = _rounded((after.x, after.y))
        walls.append((here, end))
    return walls


def _circles(
    rng: random.Random,
    perimeter: Sequence[Point],
    sites: Sequence[GateSite],
    radii: Sequence[float],
) -> list[tuple[Point, float]] | None:
    """Return a free circle for each radius, or None if a circle does not fit."""
    polygon = Polygon(perimeter)
    gates = [site.at for site in sites]
    circles: list[tuple[Point, float]] = []
    left, low, right, high = polygon.bounds
    for radius in radii:
        for _ in range(_TRIES):
            at = _rounded((rng.uniform(left, right), rng.uniform(low, high)))
            point = shapely.Point(at)
            if (
                polygon.contains(point)
                and polygon.exterior.distance(point) >= radius + 4.0
                and all(math.dist(at, gate) >= radius + GATE_RADIUS_M + 6.0 for gate in gates)
                and all(math.dist(at, other) >= radius + r + 8.0 for other, r in circles)
            ):
                circles.append((at, round(radius, 1)))
                break
        else:
            return None
    return circles


def _zones(
    rng: random.Random, inner: BaseGeometry, taken: Sequence[BaseGeometry], count: int
) -> tuple[tuple[Point, ...], ...]:
    """Return up to `count` restricted polygons that are clear of `taken`."""
    zones: list[Polygon] = []
    left, low, right, high = inner.bounds
    for _ in range(_TRIES):
        if len(zones) == count:
            break
        middle = (rng.uniform(left, right), rng.uniform(low, high))
        corners = ellipse(rng, rng.randint(4, 6), rng.uniform(8, 14), rng.uniform(6, 10))
        zone = Polygon([_rounded((middle[0] + x, middle[1] + y)) for x, y in corners])
        if inner.contains(zone) and all(
            zone.distance(other) >= _CLEAR_M for other in (*taken, *zones)
        ):
            zones.append(zone)
    return tuple(tuple((x, y) for x, y in zone.exterior.coords[:-1]) for zone in zones)


def _barriers(
    rng: random.Random, inner: BaseGeometry, taken: Sequence[BaseGeometry], count: int
) -> tuple[tuple[Point, Point], ...]:
    """Return up to `count` straight walls that can be passed on all sides."""
    walls: list[LineString] = []
    left, low, right, high = inner.bounds
    for _ in range(_TRIES):
        if len(walls) == count:
            break
        x, y = rng.uniform(left, right), rng.uniform(low, high)
        length, angle = rng.uniform(8.0, 24.0), rng.choice((0.0, 0.0, 0.5, 0.5, 0.25, 0.75))
        dx, dy = length * math.cos(angle * math.pi), length * math.sin(angle * math.pi)
        wall = LineString((_rounded((x, y)), _rounded((x + dx, y + dy))))
        if inner.contains(wall) and all(
            wall.distance(other) >= _CLEAR_M for other in (*taken, *walls)
        ):
            walls.append(wall)
    ends = ([(x, y) for x, y in wall.coords] for wall in walls)
    return tuple((start, end) for start, end in ends)


def _rounded(point: Point) -> Point:
    return (round(point[0], 2), round(point[1], 2))
