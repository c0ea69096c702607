"""The map of a picture: the ground, routes, gates, fields of view, assets, tracks and contacts."""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from math import atan2, ceil, cos, degrees, floor, inf, radians, sin
from typing import Literal, NamedTuple

from rich.cells import cell_len

from pa_console.schema.base import Point
from pa_console.schema.events.session import ReportedContact
from pa_console.schema.telemetry import AssetTelemetry, Picture, Track
from pa_console.schema.world import AssetKind, Background, Frame, World
from pa_console.tui.map.canvas import FREE, Canvas, Cell, Projection, Run, Spot, Strokes
from pa_console.tui.map.ground import FRAME_GLYPHS, MapGround, draw_ground
from pa_console.tui.map.labels import Labels
from pa_console.tui.map.markers import (
    Marker,
    Markers,
    Symbol,
    asset_symbol,
    camera_symbol,
    edge_arrow,
    track_symbol,
)
from pa_console.tui.map.plan_layer import PlanLayer, dimmed
from pa_console.tui.status_words import Reliance, cover_state, short_names, term, track_names

RAY_DEG = 7.5
"""The angle between two rays of an outline, in degrees."""

OVER_WALLS: AssetKind = "uav"
"""The kind of asset whose sight no wall blocks."""

FULL_DEG = 360.0


Sensors = Literal["", "cameras", "all"]
"""The sensors whose fields of view are shown."""


Line = tuple[Point, Point]

_ADJOINING = 2.0
"""The highest cost of a place right beside a marker that hides nothing."""

CONTACT_GLYPH, CONTACT_ROLE = "◌", "contact"
MOST_NAME = 14
"""The longest call sign on the map, in cells; the event list shows it in full."""

_FREE = FREE | {"wall"}
ROLES = (
    "background", "lane", "zone", "zone-label", "wall", "frame", "label", "leader", "gate-covered",
    "gate-uncovered", "gate-unknown", "label-uncovered", "label-unknown", "asset-field",
    "camera-field", "trail", "route", "uav", "ugv", "robot", "manual", "down", "stale", "suspect",
    "crowd", "crowd-down", "crowd-stale", "camera", "camera-failed", "camera-unknown",
    "track-unknown", "track-authorized", "track-unauthorized", "track-hostile", "track-stale",
    "warning", "detail", "legend", "ghost", "arrival", "gate-gains", "gate-loses", "dimmed",
    "contact",
)  # fmt: skip
CELLS_PER_NAME = 48
"""The minimum number of cells per asset; with fewer, only important names are written."""

MOST_RETRIES = 2
"""The maximum number of retries to place names; each starts with the names left out before."""

Window = tuple[float, Point | None]
"""The zoom of the map, and its centre; None means the middle of the site."""


def camera_fields(world: World, picture: Picture, look: Reliance) -> Iterator[tuple[Point, ...]]:
    """Yield the field of view of each working camera, as a closed line in metres."""
    walls = tuple((wall.start, wall.end) for wall in world.walls)
    for name, camera in world.cameras.items():
        report = picture.cameras.get(name)
        if report is not None and look.camera(report) == "works":
            reach, width = camera.sensor_range_m, camera.field_of_view_deg
            yield outline(camera.at, camera.heading_deg, reach, width, walls=walls)


def asset_fields(world: World, picture: Picture, look: Reliance) -> Iterator[tuple[Point, ...]]:
    """Yield the field of view of each reliable asset, as a closed line in metres."""
    walls = tuple((wall.start, wall.end) for wall in world.walls)
    for asset in picture.assets.values():
        sensor = world.platforms.get(asset.kind)
        if sensor is not None and asset.available and look.report(asset) == "fresh":
            reach, width = sensor.sensor_range_m, sensor.field_of_view_deg
            around = () if asset.kind == OVER_WALLS else walls
            yield outline(asset.position, asset.heading_deg, reach, width, walls=around)


@lru_cache(maxsize=256)
def outline(
    at: Point, heading_deg: float, reach_m: float, width_deg: float, *, walls: tuple[Line, ...]
) -> tuple[Point, ...]:
    """Return the edge of a sensor's view, a closed line in metres; `walls` block the view.

    `width_deg` is the sensor's field of view.
    """
    count = max(round(width_deg / RAY_DEG), 2)
    step, first_deg = width_deg / count, heading_deg - width_deg / 2
    turns = [radians(first_deg + step * number) for number in range(count + 1)]
    rays = [(cos(turn), sin(turn)) for turn in turns]
    reaches = [reach_m] * len(rays)
    for wall in walls:
        for number in _rays_towards(at, wall, first_deg, step, count):
            reaches[number] = min(reaches[number], _meets(at, rays[number], wall))
    edge = [(at[0] + x * far, at[1] + y * far) for (x, y), far in zip(rays, reaches, strict=True)]
    return tuple(edge) if width_deg >= FULL_DEG else (at, *edge, at)


def _rays_towards(
    at: Point, wall: Line, first_deg: float, step_deg: float, count: int
) -> Iterator[int]:
    """Yield the numbers of the rays, from 0 to `count`, that may meet a wall."""
    start, end = (degrees(atan2(y - at[1], x - at[0])) for x, y in wall)
    width = (end - start + FULL_DEG / 2) % FULL_DEG - FULL_DEG / 2
    offset = (min(start, start + width) - first_deg) % FULL_DEG
    for begin in (offset - FULL_DEG, offset):
        low, high = ceil(begin / step_deg), floor((begin + abs(width)) / step_deg)
        yield from range(max(low, 0), min(high, count) + 1)


def _meets(at: Point, ray: Point, wall: Line) -> float:
    """Return the distance at which a ray meets a wall, in metres; infinite if it does not."""
    (start_x, start_y), (end_x, end_y) = wall
    x, y, along_x, along_y = start_x - at[0], start_y - at[1], end_x - start_x, end_y - start_y
    cross = ray[0] * along_y - ray[1] * along_x
    if cross == 0.0:
        return inf
    share, far = (x * ray[1] - y * ray[0]) / cross, (x * along_y - y * along_x) / cross
    return far if far > 0.0 and 0.0 <= share <= 1.0 else inf


class _LooseName(NamedTuple):
    """A frame's name that may be hidden: each cell, its glyph, and the content beneath it."""

    frame: Frame
    run: Run
    written: list[tuple[Cell, str, Run]]


class Frames:
    """The frames of a picture; a gate shows whether it is covered, uncovered or unknown.

    A marker on a frame takes the place of the frame's sign, which is then written beside it.
    """

    def __init__(
        self,
        canvas: Canvas,
        labels: Labels,
        view: Projection,
        picture: Picture,
        involved: Collection[str] | None = None,
    ) -> None:
        """Dim covered gates that are not `involved` in a plan; None dims nothing."""
        self._canvas, self._labels, self._view = canvas, labels, view
        self._covers, self._involved = picture.gates, involved
        self._displaced: list[tuple[Frame, Run]] = []
        self._loose: list[_LooseName] = []

    def draw(self, frames: Mapping[str, Frame], places: Mapping[str, Cell]) -> None:
        """Draw the signs, and the names that must be seen or have no marker in their way."""
        shown = {name: frame for name, frame in frames.items() if self._view.shows(frame.at)}
        for name, frame in shown.items():
            cell = self._view.cell(frame.at)
            if cell not in self._canvas.marks:
                self._canvas.put(cell, *self._sign(name, frame))
                self._labels.keep(cell)
        for name in sorted(shown, key=lambda name: not self._urgent(name)):
            frame, at = shown[name], places.get(name)
            cell, sign = self._view.cell(frame.at), self._sign(name, frame)
            urgent, role = self._urgent(name), "label"
            if urgent:
                role = sign[1].replace("gate", "label")
            line = [(name, role)]
            if cell in self._canvas.marks:
                line.insert(0, sign)
            start = at and (at[0] + 1 - len(line), at[1])
            kept = name in self._covers
            loose = None if start is None or kept else self._loose_name(frame, start, line)
            if start and self._labels.write(start, line, keep=kept):
                if loose is not None:
                    self._loose.append(loose)
                continue
            if urgent:
                _ = self._place(frame, line) or self._place(frame, line[:1])
            elif at is not None:
                self._displaced.append((frame, line[-1]))
                if len(line) > 1:
                    self._place(frame, line[:1], most=_ADJOINING)

    def erase_hidden(self) -> None:
        """Remove names that are partly hidden by others, because they cannot be read."""
        for frame, run, written in self._loose:
            canvas, role = self._canvas, run[1]
            left = [
                (cell, beneath)
                for cell, glyph, beneath in written
                if canvas.at(cell) == (glyph, role)
            ]
            if len(left) == len(written):
                continue
            for cell, (glyph, below) in left:
                canvas.put(cell, glyph, below)
            self._displaced.append((frame, run))

    def name_displaced(self) -> None:
        """Write the remaining names where the markers have left room for them."""
        for frame, name in self._displaced:
            self._place(frame, [name])

    def _loose_name(self, frame: Frame, start: Cell, line: list[Run]) -> "_LooseName":
        """Return the name at the end of `line`, not yet drawn, and the cells beneath it."""
        name, before = line[-1][0], sum(len(text) for text, _ in line[:-1])
        cells = [(start[0] + before + n, start[1]) for n in range(len(name))]
        canvas = self._canvas
        written = [
            (cell, glyph, canvas.at(cell))
            for cell, glyph in zip(cells, name, strict=True)
            if canvas.holds(cell)
        ]
        return _LooseName(frame, line[-1], written)

    def _urgent(self, name: str) -> bool:
        return name in self._covers and not self._covers[name].covered

    def _sign(self, name: str, frame: Frame) -> Run:
        if name not in self._covers:
            return FRAME_GLYPHS[frame.kind], "frame"
        state = cover_state(self._covers[name])
        if state == "covered" and self._involved is not None and name not in self._involved:
            return term("gate", state).glyph, "dimmed"
        return term("gate", state).glyph, f"gate-{state}"

    def _place(self, frame: Frame, line: list[Run], most: float = inf) -> list[Cell]:
        gap = int(line[0][1].startswith("label"))
        cell, spots = self._view.cell(frame.at), [self._view.spot(frame.at)]
        return self._labels.place(cell, spots, [line], gap=gap, most=most)


class _Drawn(NamedTuple):
    at: Cell
    spot: Spot
    contact: ReportedContact


class Contacts:
    """The contacts in view; if the `whole` site is shown, others are drawn at the map's edge."""

    def __init__(
        self,
        canvas: Canvas,
        view: Projection,
        contacts: Collection[ReportedContact],
        *,
        whole: bool,
    ) -> None:
        self._drawn: list[_Drawn] = []
        for contact in contacts:
            if whole or view.shows(contact.at):
                column, row = spot = view.spot(contact.at)
                at = (
                    min(max(floor(column), 0), canvas.width - 1),
                    min(max(floor(row), 0), canvas.height - 1),
                )
                self._drawn.append(_Drawn(at, spot, contact))

    def draw(self, canvas: Canvas, labels: Labels | None) -> None:
        """Draw each contact on an empty cell; with `labels`, add its name if that hides nothing."""
        for at, (column, row), _ in self._drawn:
            if canvas.role(at) in _FREE:
                way = floor(column) - at[0], floor(row) - at[1]
                canvas.put(at, CONTACT_GLYPH if way == (0, 0) else edge_arrow(*way), CONTACT_ROLE)
        if labels is None or not self._drawn:
            return
        self._keep_what_is_there(canvas, labels)
        for at, spot, contact in self._drawn:
            hidden = "" if canvas.role(at) == CONTACT_ROLE else CONTACT_GLYPH
            name = f"{hidden}TAK {short_name(contact.name)}"
            for text in (f"{name} {contact.affiliation}?", name):
                if labels.place(at, [spot], [[(text, CONTACT_ROLE)]], gap=len(hidden)):
                    break

    def _keep_what_is_there(self, canvas: Canvas, labels: Labels) -> None:
        for row, roles in enumerate(canvas.roles):
            for column, role in enumerate(roles):
                if role not in FREE:
                    labels.keep((column, row))


def short_name(name: str) -> str:
    """Return `name` for the map: shortened, and with characters that are one cell wide."""
    plain = "".join(character if cell_len(character) == 1 else "?" for character in name)
    return plain if len(plain) <= MOST_NAME else f"{plain[: MOST_NAME - 1]}…"


def _lines(view: Projection, lines: Iterable[Sequence[Point]], period: int, on: int) -> Strokes:
    """Return the strokes for lines in metres, with `on` visible dots in each `period`."""
    strokes = Strokes()
    for line in lines:
        strokes.path([view.spot(point) for point in line], period=period, on=on)
    return strokes


class MapScene:
    """The map of one world; its ground is drawn once for each size and window."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.short = short_names(world.assets)
        self._background = world.background
        self._ground = lru_cache(maxsize=4)(self._draw_ground)

    def _draw_ground(
        self, width: int, height: int, window: Window, fit: tuple[int, int] | None
    ) -> MapGround:
        view = Projection(self.world, width, height, *window, fit)
        return draw_ground(self.world, view, self._background)

    def lay(self, background: Background) -> None:
        """Use `background` beneath everything from now on."""
        if background is not self._background:
            self._background = background
            self._ground.cache_clear()

    def draw(
        self,
        picture: Picture | None,
        width: int,
        height: int,
        window: Window = (1.0, None),
        marked: str = "",
        *,
        trails: Iterable[Sequence[Point]] = (),
        sensors: Sensors = "",
        plan: PlanLayer | None = None,
        fit: tuple[int, int] | None = None,
        contacts: Collection[ReportedContact] = (),
    ) -> Canvas:
        """Return the map of `width` x `height` cells; without a picture, only the ground.

        `marked` is the asset or track with a pointer. `trails` are the paths behind assets and
        tracks, in metres. `sensors` selects the fields of view to show. `plan` is drawn on top
        before it runs. The scale is that of a map of the size `fit`. `contacts` are reports by
        others; they are drawn only in empty cells.
        """
        ground = self._ground(width, height, window, fit)
        canvas, view = ground.canvas.copy(), ground.view
        if picture is None:
            for frame, at in ground.names.items():
                canvas.write(at, frame, "label")
            return canvas
        whole, look = window[0] <= 1.0, Reliance(picture, self.world.stale_s)
        seen = [a for a in picture.assets.values() if whole or view.shows(a.position)]
        crowded = len(seen) * CELLS_PER_NAME > width * height
        if sensors == "all":
            seen_by_assets = asset_fields(self.world, picture, look)
            _lines(view, seen_by_assets, 4, 1).draw(canvas, "asset-field", over=FREE)
        if sensors:
            seen_by_cameras = camera_fields(self.world, picture, look)
            _lines(view, seen_by_cameras, 2, 1).draw(canvas, "camera-field", over=FREE)
        if not crowded:
            routes = [(asset.position, *asset.route) for asset in seen if asset.route]
            _lines(view, trails, 2, 1).draw(canvas, "trail", over=FREE)
            _lines(view, routes, 3, 2).draw(canvas, "route", over=FREE)
        if plan is not None:
            plan.draw_routes(canvas, view)
        cameras = [
            (view.cell(spec.at), view.spot(spec.at), camera_symbol(report, look))
            for name, report in picture.cameras.items()
            if (spec := self.world.cameras.get(name)) is not None and view.shows(spec.at)
        ]
        shown = self._markers(picture, seen, view, look, plan, whole=whole, health=not crowded)
        markers = Markers(canvas, shown, marked)
        reported = Contacts(canvas, view, contacts, whole=whole)
        for at, _, symbol in cameras:
            if not (crowded and symbol.role == "camera"):
                canvas.put(at, symbol.glyph, symbol.role)
        markers.draw(canvas)

        def name(first: Sequence[Cell] = ()) -> Canvas:
            """Return a copy with all names that fit, beginning with the cells in `first`."""
            named = canvas.copy()
            labels = Labels(named, ground.barriers)
            broken = [camera for camera in cameras if camera[2].name]
            for at, _, _ in broken:
                labels.keep(at)
            involved = plan.preview.involved if plan is not None else None
            frames = Frames(named, labels, view, picture, involved)
            frames.draw(self.world.frames, ground.names)
            if plan is not None:
                plan.write(labels, ground, self.world)
            markers.name(named, labels, first, crowded=crowded)
            for at, spot, symbol in broken:
                hidden = symbol.glyph if at in named.marks else ""
                fault = [[(f"{hidden}{symbol.name}", symbol.role)]]
                labels.place(at, [spot], fault, gap=len(hidden))
            frames.erase_hidden()
            if not crowded:
                frames.name_displaced()
            reported.draw(named, None if crowded else labels)
            return named

        named, first = name(), tuple[Cell, ...]()
        for _ in range(0 if crowded else MOST_RETRIES):
            if left_out := markers.unnamed(named):
                first = (*left_out, *first)
                named = min(named, name(first), key=lambda tried: len(markers.unnamed(tried)))
        return named

    def _markers(
        self,
        picture: Picture,
        seen: Iterable[AssetTelemetry],
        view: Projection,
        look: Reliance,
        plan: PlanLayer | None,
        *,
        whole: bool,
        health: bool,
    ) -> Iterator[Marker]:
        """Yield the markers of all tracks in view and of the assets `seen`."""
        numbers = track_names(picture.tracks)
        tracks = [t for t in picture.tracks.values() if whole or view.shows(t.position)]
        symbols: list[tuple[Track | AssetTelemetry, Symbol, bool]] = [
            *((t, track_symbol(t, numbers[t.id], look), True) for t in tracks),
            *((a, asset_symbol(a, self.short, look, health=health), False) for a in seen),
        ]
        for thing, symbol, is_track in symbols:
            aside = plan is not None and plan.dims(thing.id)
            shown = dimmed(symbol) if aside else symbol
            yield Marker(thing.id, view.spot(thing.position), shown, is_track)
