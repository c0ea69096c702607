"""Symbols and markers of assets, tracks and cameras, each in its cell with its name beside it.

A cell with several markers shows their number. Names make room for each other; markers do not.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import floor, inf
from typing import NamedTuple

from pa_console.schema.telemetry import AssetTelemetry, CameraReport, Track
from pa_console.tui.map.canvas import Canvas, Cell, Run, Spot
from pa_console.tui.map.labels import Labels
from pa_console.tui.status_words import Reliance, term

_ARROWS = "→↗↑↖←↙↓↘"
_TRACK_GLYPHS = {"vehicle": "■", "person": "▪"}
WIDE_UNCERTAINTY_M = 5.0
"""The minimum uncertainty that is written beside a track, in metres."""

TROUBLE = frozenset(("down", "stale", "suspect"))
"""The roles of assets that cannot be relied on."""

MOST_DIGIT = 9
"""The highest number that a cell shows as a digit; it shows a higher one as a plus.

The number is then written beside the cell if there is room.
"""

POINTER = "▸"
MOST_NAMES = 9
"""The maximum number of names beside a cell; if there are more, only their number is written."""

DETAIL_FROM_COLUMNS = 60
"""The minimum width of a map that shows every charge and not only low ones, in columns."""

NAMES_FROM_ROWS = 12
"""The minimum height of a map with leaders to the names of dimmed markers, in rows."""

_WITHOUT_LEADER = 2.0
"""The cost of the nearest place with a leader, if it hides nothing."""

_BESIDE = 0.1
"""The cost of a place right of a marker that hides nothing."""

_PRESSING = TROUBLE | {"crowd-down", "crowd-stale"}


class Symbol(NamedTuple):
    """A symbol on the map: `glyph` in its cell, `name` and `note` beside it.

    `warning` and `detail` follow the name of an asset with a fresh report, the detail only if there
    is room.
    """

    glyph: str
    name: str
    role: str
    note: str = ""
    warning: str = ""
    detail: str = ""


def arrow(heading_deg: float) -> str:
    """Return the arrow nearest to a heading (0 east, 90 north)."""
    return _ARROWS[round(heading_deg / 45.0) % 8]


def asset_symbol(
    asset: AssetTelemetry, short: Mapping[str, str], look: Reliance, *, health: bool = True
) -> Symbol:
    """Return the symbol of an asset: `→ D1`, or `? D1 7s` if its last report is 7 s old.

    The sign for manual control replaces the heading. A low battery and a weak link follow the name,
    as in `→ D1 19%▼◐`, unless `health` is False.
    """
    name = short.get(asset.id, asset.id[:2])
    state = look.report(asset)
    down = not (asset.available or asset.manual)
    if asset.status == "failed" or (state == "fresh" and down):
        return Symbol(term("asset", "failed").glyph, name, "down")
    if state == "suspect":
        return Symbol(term("report", state).glyph, name, "suspect")
    if state != "fresh":
        return Symbol("?", name, "stale", f"{look.age(asset):.0f}s")
    if asset.manual:
        return Symbol(term("asset", "manual").glyph, name, "manual")
    if not health:
        return Symbol(arrow(asset.heading_deg), name, asset.kind)
    weak = term("comms", asset.comms).glyph if asset.comms != "ok" else ""
    charge = f"{asset.battery_pct:.0f}%" if asset.battery_known else "?"
    warning, detail = (f"{charge}▼{weak}", "") if asset.low_battery else (weak, charge)
    return Symbol(arrow(asset.heading_deg), name, asset.kind, "", warning, detail)


def track_symbol(track: Track, number: str, look: Reliance) -> Symbol:
    """Return the symbol of a track: `■ ?1` for an unknown vehicle, `■ ‼2` for a hostile one.

    The symbol of a lost track has the age of its last detection.
    """
    hostile = track.intent == "hostile"
    sign = term("intent", "hostile") if hostile else term("identity", track.identity)
    glyph, name = _TRACK_GLYPHS[track.kind], f"{sign.glyph}{number}"
    if look.lost(track):
        return Symbol(glyph, name, "track-stale", f"{look.age(track):.0f}s?")
    vague = f"±{track.uncertainty_m:.0f}" if track.uncertainty_m >= WIDE_UNCERTAINTY_M else ""
    return Symbol(glyph, name, "track-hostile" if hostile else f"track-{track.identity}", vague)


def camera_symbol(camera: CameraReport, look: Reliance) -> Symbol:
    """Return the symbol of a gate camera; for a working camera, it is the sign alone."""
    state = look.camera(camera)
    glyph = term("camera", state).glyph
    return (
        Symbol(glyph, "", "camera") if state == "works" else Symbol("▿", glyph, f"camera-{state}")
    )


def count_glyph(count: int) -> str:
    """Return the glyph for a number of markers in one cell."""
    return str(count) if count <= MOST_DIGIT else "+"


def crowd_symbol(roles: Sequence[str]) -> Symbol:
    """Return the symbol of several assets, such as `5`, `+ 12`, or `5 ✘2` if two are in trouble.

    `roles` are the roles of the assets' own symbols.
    """
    down = [role for role in roles if role in TROUBLE]
    glyph = count_glyph(len(roles))
    number = str(len(roles)) if len(roles) > MOST_DIGIT else ""
    if not down:
        return Symbol(glyph, number, "dimmed" if {*roles} == {"dimmed"} else "crowd")
    failed = "down" in down
    sign = term("asset", "failed").glyph if failed else "?"
    return Symbol(glyph, f"{number}{sign}{len(down)}", "crowd-down" if failed else "crowd-stale")


def edge_arrow(right: int, down: int) -> str:
    """Return the arrow towards a place beyond the edge, `right` and `down` cells away."""
    if down:
        return ("↖↑↗" if down < 0 else "↙↓↘")[1 + (right > 0) - (right < 0)]
    return "→" if right > 0 else "←"


class Marker(NamedTuple):
    """The marker of one asset or track: its id, its spot on the canvas, and its symbol."""

    id: str
    spot: Spot
    symbol: Symbol
    is_track: bool = False

    @property
    def in_list(self) -> str:
        """The name in the list beside a cell that shows a number."""
        symbol = self.symbol
        if self.is_track:
            return f"{symbol.glyph}{symbol.name}{symbol.note}"
        sign = symbol.glyph if symbol.role in TROUBLE else ""
        warning = f" {symbol.warning}" if symbol.warning else ""
        return f"{symbol.name}{sign}{symbol.note}{warning}"


class Markers:
    """All markers of one picture on one canvas, by cell."""

    def __init__(self, canvas: Canvas, markers: Iterable[Marker], pointed_at: str) -> None:
        """Put markers beyond the canvas at its edge; the marker `pointed_at` gets a pointer."""
        self._right, self._bottom = canvas.width - 1, canvas.height - 1
        self._pointed_at = pointed_at
        self._detailed = canvas.width >= DETAIL_FROM_COLUMNS
        cells: dict[Cell, list[Marker]] = defaultdict(list)
        for marker in markers:
            column, row = floor(marker.spot[0]), floor(marker.spot[1])
            if not (0 <= column <= self._right and 0 <= row <= self._bottom):
                column = min(max(column, 0), self._right)
                row = min(max(row, 0), self._bottom)
            cells[column, row].append(marker)
        self._cells = cells
        self._symbols = {at: self._symbol(at, here) for at, here in cells.items()}
        canvas.marks = {at: tuple([m.id for m in here]) for at, here in cells.items()}

    def _symbol(self, at: Cell, here: Sequence[Marker]) -> Symbol:
        """Return the symbol of a cell: that of its only marker, or the number of its markers."""
        symbol = here[0].symbol if len(here) == 1 else _together(here)
        beyond = self._beyond(at, here)
        return symbol._replace(glyph=beyond) if beyond else symbol

    def draw(self, canvas: Canvas) -> None:
        """Draw every marker."""
        for at, symbol in self._symbols.items():
            canvas.put(at, symbol.glyph, symbol.role)

    def _beyond(self, at: Cell, here: Sequence[Marker]) -> str:
        """Return an arrow towards markers beyond the edge; '' if a marker is in the cell itself."""
        if 0 < at[0] < self._right and 0 < at[1] < self._bottom:
            return ""
        ways = [(floor(m.spot[0]) - at[0], floor(m.spot[1]) - at[1]) for m in here]
        return "" if (0, 0) in ways else edge_arrow(*ways[0])

    def name(self, canvas: Canvas, labels: Labels, first: Sequence[Cell], *, crowded: bool) -> None:
        """Write the names, those of the cells in `first` and the most urgent before the others.

        In a crowded view, only important names are written. On a low map, dimmed markers come last
        and get no leader.
        """
        details: list[tuple[list[Cell], str]] = []
        low = canvas.height < NAMES_FROM_ROWS
        last = {at for at in self._cells if low and self._dimmed(at)}
        for at in sorted(self._cells, key=lambda at: (at in last, at not in first, self._rank(at))):
            here = self._cells[at]
            pointed = self._pointed(at)
            most = _WITHOUT_LEADER if at in last else inf
            if len(here) == 1 and (pointed or not crowded or here[0].is_track):
                names = self._name_one(labels, at, here[0], most)
                if names and self._detailed and here[0].symbol.detail:
                    details.append((names[0], here[0].symbol.detail))
            elif (crowded and not pointed) or len(here) > MOST_NAMES:
                names = self._name_crowd(labels, at, here, crowded=crowded)
            else:
                names = self._name_several(labels, at, here, most)
            if names:
                canvas.labels[at] = names
        for cells, detail in details:
            labels.extend(cells, detail, "detail")

    def unnamed(self, canvas: Canvas) -> list[Cell]:
        """Return the cells of markers without any text beside them."""
        return [at for at in self._cells if at not in canvas.labels]

    def _dimmed(self, at: Cell) -> bool:
        return self._symbols[at].role == "dimmed" and not self._pointed(at)

    def _pointed(self, at: Cell) -> bool:
        return any(marker.id == self._pointed_at for marker in self._cells[at])

    def _rank(self, at: Cell) -> int:
        here = self._cells[at]
        if self._pointed_at and self._pointed(at):
            return 0
        if any(marker.is_track for marker in here):
            return 1
        return 2 if self._symbols[at].role in _PRESSING else 3

    def _name_one(self, labels: Labels, at: Cell, marker: Marker, most: float) -> list[list[Cell]]:
        symbol = marker.symbol
        text = f"{symbol.name} {symbol.note}" if symbol.note else symbol.name
        if self._beyond(at, [marker]):
            text = f"{symbol.glyph}{text}"
        line = [(f"{self._pointer(marker)}{text}", symbol.role)]
        if symbol.warning:
            line.append((f" {symbol.warning}", "warning"))
        cells = labels.place(at, [marker.spot], [line], most=most)
        return [cells] if cells else []

    def _name_several(
        self, labels: Labels, at: Cell, here: Sequence[Marker], most: float
    ) -> list[list[Cell]]:
        """Write all names in one block, or else each name for which there is room."""
        spots = [marker.spot for marker in here]
        for rows in range(1, min(len(here), 3) + 1):
            size = -(-len(here) // rows)
            parts = [here[first : first + size] for first in range(0, len(here), size)]
            block = [list(self._listed(part)) for part in parts]
            if cells := labels.place(at, spots, block, gap=1, most=most):
                return [cells]
        labels_apart = [
            labels.place(at, [marker.spot], [list(self._listed([marker]))], gap=1, most=most)
            for marker in here
        ]
        return [cells for cells in labels_apart if cells]

    def _listed(self, here: Sequence[Marker]) -> Iterator[Run]:
        for count, marker in enumerate(here):
            if count:
                yield " ", ""
            yield f"{self._pointer(marker)}{marker.in_list}", marker.symbol.role

    def _pointer(self, marker: Marker) -> str:
        return POINTER if marker.id == self._pointed_at else ""

    def _name_crowd(
        self, labels: Labels, at: Cell, here: Sequence[Marker], *, crowded: bool
    ) -> list[list[Cell]]:
        """Write what a number hides: tracks, assets in trouble, and numbers above nine."""
        symbol, spots, cells = self._symbols[at], [marker.spot for marker in here], list[Cell]()
        if tracks := [marker for marker in here if marker.is_track]:
            cells = labels.place(at, spots, [list(self._listed(tracks))], gap=1)
        elif not crowded:
            cells = labels.place(at, spots, [[(f"×{symbol.name}", symbol.role)]], gap=1)
        elif len(here) > 1 and symbol.name:
            cells = labels.place(at, spots, [[(symbol.name, symbol.role)]], most=_BESIDE)
        return [cells] if cells else []


def _together(here: Sequence[Marker]) -> Symbol:
    """Return the symbol of several markers in one cell."""
    roles = [marker.symbol.role for marker in here]
    if any(marker.is_track for marker in here):
        tracks = [marker.symbol.role for marker in here if marker.is_track]
        worst = "track-hostile" if "track-hostile" in tracks else tracks[0]
        return Symbol(count_glyph(len(here)), str(len(here)), worst)
    return crowd_symbol(roles)
