"""Draws the picture over the ground: cover of gates, routes, cameras, assets and tracks."""

from collections.abc import Iterable
from functools import lru_cache
from itertools import pairwise

from pa_console.schema.base import Point
from pa_console.schema.telemetry import AssetTelemetry, Picture
from pa_console.schema.world import World
from pa_console.tui.condition import Reliance, cover_state
from pa_console.tui.map.canvas import Canvas, Cell, straight
from pa_console.tui.map.ground import draw_ground, place_label
from pa_console.tui.map.placing import FREE, Placer
from pa_console.tui.map.projection import Projection
from pa_console.tui.map.tokens import asset_token, camera_token, crowd_token, track_token
from pa_console.tui.vocabulary import term
from pa_console.tui.words import short_names, track_names

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


class Scene:
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
