"""Draws the picture over the ground: cover of gates, routes, cameras, assets and tracks."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import pairwise

from pa_console.schema.base import Point
from pa_console.schema.telemetry import AssetTelemetry, CameraReport, Picture, Track
from pa_console.schema.world import World
from pa_console.tui.map.canvas import Canvas, Cell, straight
from pa_console.tui.map.ground import draw_ground, place_label
from pa_console.tui.map.projection import Projection
from pa_console.tui.report_condition import Reliance, cover_state
from pa_console.tui.status_words import term
from pa_console.tui.words import short_names, track_names

_ARROWS = "→↗↑↖←↙↓↘"
_TRACK_GLYPHS = {"vehicle": "■", "person": "▪"}
WIDE_UNCERTAINTY_M = 5.0
"""From here on the position's uncertainty is written beside a track, in metres."""

Token = tuple[str, str]
"""(text, role)"""


def arrow(heading_deg: float) -> str:
    """Return the arrow nearest to a heading (0 east, 90 north)."""
    return _ARROWS[round(heading_deg / 45.0) % 8]


def asset_token(asset: AssetTelemetry, short: Mapping[str, str], look: Reliance) -> Token:
    """Return e.g. `D1→`, or `D1?7s` when the last report is 7 s old and proves nothing any more."""
    name = short.get(asset.id, asset.id[:2])
    state = look.report(asset)
    if asset.status == "failed" or (state == "fresh" and not asset.available):
        return f"{name}{term('asset', 'failed').glyph}", "down"
    if state == "suspect":
        return f"{name}{term('report', state).glyph}", "suspect"
    if state != "fresh":
        return f"{name}?{look.age(asset):.0f}s", "stale"
    return f"{name}{arrow(asset.heading_deg)}", asset.kind


def track_token(track: Track, number: str, look: Reliance) -> Token:
    """Return e.g. `■?1` (an unknown vehicle) or `■‼2` (a hostile one); unseen ones have an age."""
    hostile = track.intent == "hostile"
    sign = term("intent", "hostile") if hostile else term("identity", track.identity)
    text = f"{_TRACK_GLYPHS[track.kind]}{sign.glyph}{number}"
    if look.lost(track):
        return f"{text}?{look.age(track):.0f}s", "track-stale"
    if track.uncertainty_m >= WIDE_UNCERTAINTY_M:
        text += f"±{track.uncertainty_m:.0f}"
    return text, "track-hostile" if hostile else f"track-{track.identity}"


def camera_token(camera: CameraReport, look: Reliance) -> Token:
    """Return the sign of a gate camera."""
    state = look.camera(camera)
    glyph = term("camera", state).glyph
    return (glyph, "camera") if state == "works" else (f"▿{glyph}", f"camera-{state}")


def crowd_token(assets: Sequence[AssetTelemetry], look: Reliance) -> Token:
    """Return e.g. `×12`, or `×12✘2` when two of the twelve cannot be counted on."""
    down = [a for a in assets if not a.available or look.report(a) != "fresh"]
    if not down:
        return f"×{len(assets)}", "crowd"
    doubtful = all(a.status != "failed" and look.report(a) != "fresh" for a in down)
    sign = "?" if doubtful else term("asset", "failed").glyph
    return f"×{len(assets)}{sign}{len(down)}", "stale" if doubtful else "crowd-down"


FREE = frozenset(("", "lane", "zone", "route"))
_SPARED = frozenset(("wall", "frame", "gate-covered", "gate-uncovered", "gate-unknown"))
_TAKEN_COST = 50.0


class Placer:
    """Writes tokens on one canvas, each as near to its true cell as room allows."""

    def __init__(self, canvas: Canvas) -> None:
        self._canvas = canvas
        self._taken: set[Cell] = set()

    def place(self, at: Cell, token: Token, *, over_walls: bool = False) -> None:
        """Write a token; names give way to it, other tokens do not."""
        canvas, (text, role) = self._canvas, token
        width = len(text)
        column = min(max(at[0], 1), canvas.width - width + 1)
        row = min(max(at[1], 0), canvas.height - 1)
        best, least = (column - 1, row), 1e9
        for distance, dx, dy in _near():
            if distance >= least:
                break
            start, line = column - 1 + dx, row + dy
            if start < 0 or start + width > canvas.width or not 0 <= line < canvas.height:
                continue
            cells = [(start + offset, line) for offset in range(width)]
            cost = distance + sum(self._cost(cell, over_walls) for cell in cells)
            if cost < least:
                best, least = cells[0], cost
        canvas.write(best, text, role)
        self._taken.update((best[0] + offset, best[1]) for offset in range(-1, width + 1))

    def _cost(self, cell: Cell, over_walls: bool) -> float:
        if cell in self._taken:
            return _TAKEN_COST
        role = self._canvas.role(cell)
        if role in FREE or (over_walls and role == "wall"):
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


ROLES = (
    "lane", "zone", "zone-label", "wall", "frame", "label", "gate-covered", "gate-uncovered",
    "gate-unknown", "label-uncovered", "label-unknown", "route", "uav", "ugv", "robot", "down",
    "stale", "suspect", "crowd", "crowd-down", "camera", "camera-failed", "camera-unknown",
    "track-unknown", "track-authorized", "track-unauthorized", "track-hostile", "track-stale",
    "legend",
)  # fmt: skip

CROWD_CELLS = (6, 2)
"""Assets within a block of so many columns and rows are drawn as one, in a crowded view."""

CROWD_SHARE = 0.25
"""A view is crowded when it has more assets than this share of its blocks."""

Window = tuple[float, Point | None]
"""How far the map is zoomed in, and around which point."""


class MapScene:
    """Draws one world; the ground is drawn once for each size and window."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.short = short_names(world.assets)
        self._ground = lru_cache(maxsize=4)(self._draw_ground)

    def _draw_ground(
        self, width: int, height: int, window: Window
    ) -> tuple[Projection, Canvas, dict[str, Cell]]:
        view = Projection(self.world, width, height, *window)
        return view, *draw_ground(self.world, view)

    def draw(
        self,
        picture: Picture | None,
        width: int,
        height: int,
        window: Window = (1.0, None),
        marked: str = "",
    ) -> Canvas:
        """Return the map of `width` x `height` cells; without a picture only the ground.

        `marked` is the asset or track that gets a pointer.
        """
        view, ground, labels = self._ground(width, height, window)
        canvas = ground.copy()
        if picture is None:
            return canvas
        look, placer = Reliance(picture, self.world.stale_s), Placer(canvas)
        seen = [asset for asset in picture.assets.values() if view.shows(asset.position)]
        if window[0] <= 1.0:
            seen = list(picture.assets.values())
        crowded = len(seen) > CROWD_SHARE * width * height / (CROWD_CELLS[0] * CROWD_CELLS[1])
        _gates(canvas, view, picture, labels)
        if not crowded:
            for asset in seen:
                _route(canvas, view, asset)
        numbers = track_names(picture.tracks)
        for track in picture.tracks.values():
            if window[0] <= 1.0 or view.shows(track.position):
                text, role = track_token(track, numbers[track.id], look)
                text = f"▸{text}" if track.id == marked else text
                placer.place(view.cell(track.position), (text, role), over_walls=True)
        for name, camera in sorted(picture.cameras.items()):
            spec = self.world.cameras.get(name)
            fine = look.camera(camera) == "works"
            if spec is not None and view.shows(spec.at) and not (crowded and fine):
                placer.place(view.cell(spec.at), camera_token(camera, look))
        for group in _crowds(seen, view) if crowded else ([asset] for asset in seen):
            named = next((asset for asset in group if asset.id == marked), None)
            if named is None and len(group) > 1:
                placer.place(_middle([view.cell(a.position) for a in group]),
                             crowd_token(group, look))  # fmt: skip
                continue
            text, role = asset_token(named or group[0], self.short, look)
            text = f"▸{text}" if named is not None else text
            placer.place(view.cell((named or group[0]).position), (text, role))
        return canvas


def _crowds(assets: Iterable[AssetTelemetry], view: Projection) -> list[list[AssetTelemetry]]:
    """Put assets of the same block of cells together, smallest groups first."""
    blocks: dict[Cell, list[AssetTelemetry]] = {}
    for asset in assets:
        column, row = view.cell(asset.position)
        blocks.setdefault((column // CROWD_CELLS[0], row // CROWD_CELLS[1]), []).append(asset)
    return sorted(blocks.values(), key=len)


def _middle(cells: list[Cell]) -> Cell:
    return (
        round(sum(cell[0] for cell in cells) / len(cells)),
        round(sum(cell[1] for cell in cells) / len(cells)),
    )


def _gates(canvas: Canvas, view: Projection, picture: Picture, labels: dict[str, Cell]) -> None:
    """Mark gates as covered, uncovered or unknown; the name of one not covered stands out."""
    centre = (canvas.width // 2, canvas.height // 2)
    for name, cover in picture.gates.items():
        frame = view.world.frames.get(name)
        if frame is None or not view.shows(frame.at):
            continue
        cell, state = view.cell(frame.at), cover_state(cover)
        canvas.put(cell, term("gate", state).glyph, f"gate-{state}")
        if state == "covered":
            continue
        if name in labels:
            canvas.write(labels[name], name, f"label-{state}")
        else:
            place_label(canvas, cell, name, f"label-{state}", away_from=centre)


def _route(canvas: Canvas, view: Projection, asset: AssetTelemetry) -> None:
    cells = [view.cell(point) for point in (asset.position, *asset.route)]
    for start, end in pairwise(cells):
        for count, cell in enumerate(straight(start, end)):
            if count % 2 == 0 and canvas.holds(cell) and canvas.role(cell) in FREE:
                canvas.put(cell, "•", "route")
