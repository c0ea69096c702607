"""Draws the picture over the ground: cover of gates, routes, assets and tracks."""

from collections.abc import Iterator, Mapping
from functools import lru_cache
from itertools import pairwise

from pa_console.schema.telemetry import AssetTelemetry, Picture, Track
from pa_console.schema.world import World
from pa_console.tui.map.canvas import Canvas, Cell, straight
from pa_console.tui.map.ground import draw_ground
from pa_console.tui.map.projection import Projection
from pa_console.tui.vocabulary import term
from pa_console.tui.words import short_names

_ARROWS = "→↗↑↖←↙↓↘"
_TRACK_GLYPHS = {"vehicle": "■", "person": "▪"}
_FREE = frozenset(("", "lane", "zone", "route"))
_SPARED = frozenset(("wall", "frame", "gate-covered", "gate-uncovered"))

ROLES = (
    "lane", "zone", "zone-label", "wall", "frame", "label", "gate-covered", "gate-uncovered",
    "label-uncovered", "route", "uav", "ugv", "robot", "down", "track-unknown",
    "track-authorized", "track-unauthorized", "legend",
)  # fmt: skip


def arrow(heading_deg: float) -> str:
    """Return the arrow nearest to a heading (0 east, 90 north)."""
    return _ARROWS[round(heading_deg / 45.0) % 8]


class Scene:
    """Draws one world; the ground is drawn once for each size."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.short = short_names(world.assets)
        self._ground = lru_cache(maxsize=4)(self._draw_ground)

    def _draw_ground(self, width: int, height: int) -> tuple[Projection, Canvas]:
        view = Projection(self.world, width, height)
        return view, draw_ground(self.world, view)

    def draw(self, picture: Picture | None, width: int, height: int) -> Canvas:
        """Return the map of `width` x `height` cells; without a picture only the ground."""
        view, ground = self._ground(width, height)
        canvas = ground.copy()
        if picture is None:
            return canvas
        _gates(canvas, view, picture)
        for asset in picture.assets.values():
            _route(canvas, view, asset)
        taken: set[Cell] = set()
        for number, track in enumerate(picture.tracks.values(), start=1):
            token = track_token(track, number)
            _place(canvas, view.cell(track.position), token, taken, over_walls=True)
        for asset in sorted(picture.assets.values(), key=lambda item: item.id):
            token = asset_token(asset, self.short)
            _place(canvas, view.cell(asset.position), token, taken)
        return canvas


def asset_token(asset: AssetTelemetry, short: Mapping[str, str]) -> tuple[str, str]:
    """Return what stands for an asset, e.g. `D1→`, and its role; one that is down says so."""
    name = short.get(asset.id, asset.id[:2])
    if asset.status == "failed":
        return f"{name}{term('asset', 'failed').glyph}", "down"
    if asset.comms == "lost":
        return f"{name}?", "down"
    return f"{name}{arrow(asset.heading_deg)}", asset.kind


def track_token(track: Track, number: int) -> tuple[str, str]:
    """Return what stands for a track, e.g. `■?1` (an unknown vehicle), and its role."""
    sign = term("identity", track.identity).glyph
    return f"{_TRACK_GLYPHS[track.kind]}{sign}{number}", f"track-{track.identity}"


def _gates(canvas: Canvas, view: Projection, picture: Picture) -> None:
    """Mark covered and uncovered gates; the name of an uncovered one stands out too."""
    for name, cover in picture.gates.items():
        if name not in view.world.frames:
            continue
        cell = view.cell(view.world.frames[name].at)
        state = "covered" if cover.covered else "uncovered"
        canvas.put(cell, term("gate", state).glyph, f"gate-{state}")
        if not cover.covered:
            for row in range(max(0, cell[1] - 1), min(canvas.height, cell[1] + 2)):
                start = "".join(canvas.glyphs[row]).find(name)
                if start >= 0 and canvas.role((start, row)) == "label":
                    canvas.write((start, row), name, "label-uncovered")


def _route(canvas: Canvas, view: Projection, asset: AssetTelemetry) -> None:
    cells = [view.cell(point) for point in (asset.position, *asset.route)]
    for start, end in pairwise(cells):
        for count, cell in enumerate(straight(start, end)):
            if count % 2 == 0 and canvas.holds(cell) and canvas.role(cell) in _FREE:
                canvas.put(cell, "•", "route")


def _place(
    canvas: Canvas, at: Cell, token: tuple[str, str], taken: set[Cell], *, over_walls: bool = False
) -> None:
    """Write a token as near to its true cell as room allows; names give way to it."""
    text, role = token
    width = len(text)
    column = min(max(at[0], 1), canvas.width - width + 1)
    row = min(max(at[1], 0), canvas.height - 1)
    best, least = (column - 1, row), 1e9
    for distance, dx, dy in _near():
        if distance >= least:
            break
        cells = [(column - 1 + dx + offset, row + dy) for offset in range(width)]
        if not all(canvas.holds(cell) for cell in cells):
            continue
        cost = distance + sum(_cost(canvas, cell, taken, over_walls) for cell in cells)
        if cost < least:
            best, least = cells[0], cost
    canvas.write(best, text, role)
    taken.update((best[0] + offset, best[1]) for offset in range(-1, width + 1))


def _cost(canvas: Canvas, cell: Cell, taken: set[Cell], over_walls: bool) -> float:
    if cell in taken:
        return 50.0
    role = canvas.role(cell)
    if role in _FREE or (over_walls and role == "wall"):
        return 0.0
    return 2.5 if role in _SPARED else 0.8


@lru_cache(maxsize=1)
def _near() -> tuple[tuple[float, int, int], ...]:
    """Offsets around a cell, nearest first; a row counts as two columns."""
    return tuple(sorted(_offsets()))


def _offsets() -> Iterator[tuple[float, int, int]]:
    for dy in range(-2, 3):
        for dx in range(-7, 8):
            yield (abs(dx) / 2 + abs(dy)) * 1.2, dx, dy
