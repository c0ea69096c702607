"""Draws the picture over the ground: routes, cover of gates, cameras, assets and tracks."""

from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from math import inf

from pa_console.schema.base import Point
from pa_console.schema.telemetry import AssetTelemetry, Picture
from pa_console.schema.world import Frame, World
from pa_console.tui.map.canvas import Canvas, Cell, Run
from pa_console.tui.map.ground import FRAME_GLYPHS, Ground, draw_ground
from pa_console.tui.map.labels import Labels
from pa_console.tui.map.markers import Marker, Markers
from pa_console.tui.map.projection import Projection
from pa_console.tui.map.strokes import Strokes
from pa_console.tui.map.symbols import asset_symbol, camera_symbol, track_symbol
from pa_console.tui.report_condition import Reliance, cover_state
from pa_console.tui.status_words import term
from pa_console.tui.words import short_names, track_names

ROLES = (
    "lane", "zone", "zone-label", "wall", "frame", "label", "leader", "gate-covered",
    "gate-uncovered", "gate-unknown", "label-uncovered", "label-unknown", "route", "uav", "ugv",
    "robot", "down", "stale", "suspect", "crowd", "crowd-down", "crowd-stale", "camera",
    "camera-failed", "camera-unknown", "track-unknown", "track-authorized", "track-unauthorized",
    "track-hostile", "track-stale", "legend",
)  # fmt: skip

CELLS_PER_NAME = 48
"""With less room than this for each asset, names are left out except those that matter."""

_FREE = frozenset(("", "lane", "zone", "route"))
_ADJOINING = 2.0
"""What a place right beside a marker costs less than, if it hides nothing."""

Window = tuple[float, Point | None]
"""How far the map is zoomed in, and around which point."""


def _draw_routes(canvas: Canvas, view: Projection, assets: Iterable[AssetTelemetry]) -> None:
    strokes = Strokes()
    for asset in assets:
        if asset.route:
            spots = [view.spot(point) for point in (asset.position, *asset.route)]
            strokes.path(spots, period=3, on=2)
    strokes.draw(canvas, "route", over=_FREE)


class MapScene:
    """Draws one world; the ground is drawn once for each size and window."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.short = short_names(world.assets)
        self._ground = lru_cache(maxsize=4)(self._draw_ground)

    def _draw_ground(self, width: int, height: int, window: Window) -> Ground:
        return draw_ground(self.world, Projection(self.world, width, height, *window))

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
        ground = self._ground(width, height, window)
        canvas, view = ground.canvas.copy(), ground.view
        if picture is None:
            for name, at in ground.names.items():
                canvas.write(at, name, "label")
            return canvas
        whole, look = window[0] <= 1.0, Reliance(picture, self.world.stale_s)
        seen = [a for a in picture.assets.values() if whole or view.shows(a.position)]
        crowded = len(seen) * CELLS_PER_NAME > width * height
        if not crowded:
            _draw_routes(canvas, view, seen)
        found = self._markers(picture, view, seen, look, whole=whole)
        markers = Markers(canvas, found, look, marked)
        labels = Labels(canvas, ground.barriers)
        self._draw_cameras(canvas, labels, view, picture, look, crowded=crowded)
        markers.draw()
        frames = _Frames(canvas, labels, view, picture)
        frames.draw(self.world.frames, ground.names)
        markers.name(labels, crowded=crowded)
        self._name_cameras(labels, canvas, view, picture, look)
        if not crowded:
            frames.name_displaced()
        return canvas

    def _markers(
        self,
        picture: Picture,
        view: Projection,
        seen: Iterable[AssetTelemetry],
        look: Reliance,
        *,
        whole: bool,
    ) -> Iterator[Marker]:
        numbers = track_names(picture.tracks)
        for track in picture.tracks.values():
            if whole or view.shows(track.position):
                symbol = track_symbol(track, numbers[track.id], look)
                yield Marker(track, view.spot(track.position), symbol)
        for asset in seen:
            yield Marker(asset, view.spot(asset.position), asset_symbol(asset, self.short, look))

    def _draw_cameras(
        self,
        canvas: Canvas,
        labels: Labels,
        view: Projection,
        picture: Picture,
        look: Reliance,
        *,
        crowded: bool,
    ) -> None:
        """Draw cameras; in a crowded view only those that do not work."""
        for name, camera in picture.cameras.items():
            spec, symbol = self.world.cameras.get(name), camera_symbol(camera, look)
            if spec is not None and not (crowded and symbol.role == "camera"):
                canvas.put(view.cell(spec.at), symbol.glyph, symbol.role)
                if symbol.name:
                    labels.keep(view.cell(spec.at))

    def _name_cameras(
        self, labels: Labels, canvas: Canvas, view: Projection, picture: Picture, look: Reliance
    ) -> None:
        """Say beside a camera that does not work what is wrong with it."""
        for name, camera in picture.cameras.items():
            spec, symbol = self.world.cameras.get(name), camera_symbol(camera, look)
            if spec is not None and symbol.name and view.shows(spec.at):
                at = view.cell(spec.at)
                hidden = symbol.glyph if at in canvas.marks else ""
                block = [[(f"{hidden}{symbol.name}", symbol.role)]]
                labels.place(at, [view.spot(spec.at)], block, gap=len(hidden))


class _Frames:
    """Draws the frames of a picture; a gate shows whether it is covered, uncovered or unknown.

    A marker on a frame goes before the frame's sign, which then stands beside it.
    """

    def __init__(self, canvas: Canvas, labels: Labels, view: Projection, picture: Picture) -> None:
        self._canvas, self._labels, self._view = canvas, labels, view
        self._covers = picture.gates
        self._displaced: list[tuple[Frame, Run]] = []

    def draw(self, frames: Mapping[str, Frame], places: Mapping[str, Cell]) -> None:
        """Draw signs, and those names that must be seen or have no marker in their way."""
        shown = {name: frame for name, frame in frames.items() if self._view.shows(frame.at)}
        for name in sorted(shown, key=lambda name: not self._urgent(name)):
            frame, at = shown[name], places.get(name)
            cell, sign = self._view.cell(frame.at), self._sign(name, frame)
            urgent, role = self._urgent(name), "label"
            if urgent:
                role = sign[1].replace("gate", "label")
            line = [(name, role)]
            if cell in self._canvas.marks:
                line.insert(0, sign)
            else:
                self._canvas.put(cell, *sign)
                self._labels.keep(cell)
            start = at and (at[0] + 1 - len(line), at[1])
            if start and self._labels.write(start, line, keep=urgent):
                continue
            if urgent:
                _ = self._place(frame, line) or self._place(frame, line[:1])
            elif at is not None:
                self._displaced.append((frame, line[-1]))
                if len(line) > 1:
                    self._place(frame, line[:1], most=_ADJOINING)

    def name_displaced(self) -> None:
        """Write the other names where assets have left room for them."""
        for frame, name in self._displaced:
            self._place(frame, [name])

    def _urgent(self, name: str) -> bool:
        return name in self._covers and not self._covers[name].covered

    def _sign(self, name: str, frame: Frame) -> Run:
        if name not in self._covers:
            return FRAME_GLYPHS[frame.kind], "frame"
        state = cover_state(self._covers[name])
        return term("gate", state).glyph, f"gate-{state}"

    def _place(self, frame: Frame, line: list[Run], most: float = inf) -> list[Cell]:
        gap = int(line[0][1].startswith("label"))
        cell, spots = self._view.cell(frame.at), [self._view.spot(frame.at)]
        return self._labels.place(cell, spots, [line], gap=gap, most=most)
