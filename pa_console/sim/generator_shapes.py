"""Outlines of generated perimeters: counterclockwise polygons of about unit size."""

import math
import random
from collections.abc import Sequence

from pa_console.schema.base import Point


def outline(rng: random.Random) -> list[Point]:
    """Return a rectangle, an L, a T or a convex polygon with many sides."""
    return rng.choice((_rectangle, _ell, _tee, _polygon))(rng)


def scaled(points: Sequence[Point], size_m: float) -> tuple[Point, ...]:
    """Return `points` with their unit made `size_m` metres, to the decimetre."""
    return tuple((round(x * size_m, 1), round(y * size_m, 1)) for x, y in points)


def ellipse(rng: random.Random, sides: int, a: float, b: float) -> list[Point]:
    """Return a convex polygon with its corners on an ellipse of half axes `a` and `b`."""
    turn = rng.uniform(0.0, math.tau)
    angles = [turn + (k + rng.uniform(-0.2, 0.2)) * math.tau / sides for k in range(sides)]
    return [(a * math.cos(angle), b * math.sin(angle)) for angle in angles]


def _rectangle(rng: random.Random) -> list[Point]:
    x, y = rng.uniform(0.5, 0.8), rng.uniform(0.35, 0.6)
    return [(-x, -y), (x, -y), (x, y), (-x, y)]


def _ell(rng: random.Random) -> list[Point]:
    """Return an L; the notch is its upper right corner, or a mirror image of that."""
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
