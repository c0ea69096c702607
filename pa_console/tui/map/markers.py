"""Markers of assets and tracks: each in the cell where the thing is, with its name beside it.

A cell with several shows their number; names make room, markers do not.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import floor

from pa_console.schema.telemetry import AssetTelemetry, Track
from pa_console.tui.map.canvas import Canvas, Cell, Run, Spot
from pa_console.tui.map.labels import Labels
from pa_console.tui.map.symbols import Symbol, count_glyph, crowd_symbol, edge_arrow
from pa_console.tui.report_condition import Reliance

POINTER = "▸"
MOST_NAMES = 9
"""A cell with more things than this shows their number only."""

_BESIDE = 0.1
"""The cost of a place right of a marker that hides nothing."""

_TROUBLE = frozenset(("down", "stale", "suspect"))


@dataclass(frozen=True)
class Marker:
    """One asset or track, where on the canvas it is, and how it is shown."""

    thing: AssetTelemetry | Track
    spot: Spot
    symbol: Symbol

    @property
    def in_list(self) -> str:
        """How it is named where its cell shows a number."""
        symbol = self.symbol
        if isinstance(self.thing, Track):
            return f"{symbol.glyph}{symbol.name}{symbol.note}"
        sign = symbol.glyph if symbol.role in _TROUBLE else ""
        return f"{symbol.name}{sign}{symbol.note}"


class Markers:
    """All markers of one picture on one canvas, by their cells."""

    def __init__(
        self, canvas: Canvas, markers: Iterable[Marker], look: Reliance, pointed_at: str
    ) -> None:
        """What lies beyond the canvas is marked at its edge; `pointed_at` gets a pointer."""
        self._canvas, self._look, self._pointed_at = canvas, look, pointed_at
        cells: dict[Cell, list[Marker]] = defaultdict(list)
        for marker in markers:
            column, row = floor(marker.spot[0]), floor(marker.spot[1])
            at = min(max(column, 0), canvas.width - 1), min(max(row, 0), canvas.height - 1)
            cells[at].append(marker)
        self._cells = cells
        canvas.marks = {at: tuple(m.thing.id for m in here) for at, here in cells.items()}

    def draw(self) -> None:
        """Draw every marker."""
        for at, here in self._cells.items():
            symbol = here[0].symbol if len(here) == 1 else self._together(here)
            glyph = self._beyond(at, here) or symbol.glyph
            self._canvas.put(at, glyph, symbol.role)

    def _beyond(self, at: Cell, here: Sequence[Marker]) -> str:
        """Return an arrow towards what lies beyond the edge; '' where something is in the cell."""
        ways = [(floor(m.spot[0]) - at[0], floor(m.spot[1]) - at[1]) for m in here]
        return "" if (0, 0) in ways else edge_arrow(*ways[0])

    def _together(self, here: Sequence[Marker]) -> Symbol:
        """Return the symbol of several things in one cell."""
        tracks = [marker for marker in here if isinstance(marker.thing, Track)]
        if tracks:
            worst = min(tracks, key=lambda marker: marker.symbol.role != "track-hostile")
            return Symbol(count_glyph(len(here)), str(len(here)), worst.symbol.role)
        assets = [marker.thing for marker in here if isinstance(marker.thing, AssetTelemetry)]
        return crowd_symbol(assets, self._look)

    def name(self, labels: Labels, *, crowded: bool) -> None:
        """Write the names of all, the most urgent first; in a crowded view only what matters."""
        for at, here in sorted(self._cells.items(), key=lambda item: self._rank(item[1])):
            pointed = self._pointed_at in self._canvas.marks[at]
            if len(here) == 1 and (pointed or not crowded or isinstance(here[0].thing, Track)):
                self._name_one(labels, at, here[0])
            elif (crowded and not pointed) or len(here) > MOST_NAMES:
                self._name_crowd(labels, at, here, crowded=crowded)
            else:
                self._name_several(labels, at, here)

    def _rank(self, here: Sequence[Marker]) -> int:
        if any(marker.thing.id == self._pointed_at for marker in here):
            return 0
        if any(isinstance(marker.thing, Track) for marker in here):
            return 1
        return 2 if any(marker.symbol.role in _TROUBLE for marker in here) else 3

    def _name_one(self, labels: Labels, at: Cell, marker: Marker) -> None:
        symbol = marker.symbol
        text = f"{symbol.name} {symbol.note}" if symbol.note else symbol.name
        if self._beyond(at, [marker]):
            text = f"{symbol.glyph}{text}"
        text = f"{self._pointer(marker)}{text}"
        self._record(at, labels.place(at, [marker.spot], [[(text, symbol.role)]]))

    def _name_several(self, labels: Labels, at: Cell, here: Sequence[Marker]) -> None:
        """Write all names in one block, or else each where there is room."""
        spots = [marker.spot for marker in here]
        for rows in range(1, min(len(here), 3) + 1):
            size = -(-len(here) // rows)
            parts = [here[first : first + size] for first in range(0, len(here), size)]
            block = [list(self._listed(part)) for part in parts]
            if self._record(at, labels.place(at, spots, block, gap=1)):
                return
        for marker in here:
            block = [list(self._listed([marker]))]
            self._record(at, labels.place(at, [marker.spot], block, gap=1))

    def _record(self, at: Cell, cells: list[Cell]) -> bool:
        if cells:
            self._canvas.labels.setdefault(at, []).append(cells)
        return bool(cells)

    def _listed(self, here: Sequence[Marker]) -> Iterator[Run]:
        for count, marker in enumerate(here):
            if count:
                yield " ", ""
            yield f"{self._pointer(marker)}{marker.in_list}", marker.symbol.role

    def _pointer(self, marker: Marker) -> str:
        return POINTER if marker.thing.id == self._pointed_at else ""

    def _name_crowd(
        self, labels: Labels, at: Cell, here: Sequence[Marker], *, crowded: bool
    ) -> None:
        """Write what the number alone does not tell: how many are in trouble, or above nine."""
        tracks = [marker for marker in here if isinstance(marker.thing, Track)]
        spots, symbol = [marker.spot for marker in here], self._together(here)
        if tracks:
            self._record(at, labels.place(at, spots, [list(self._listed(tracks))], gap=1))
        elif not crowded:
            self._record(at, labels.place(at, spots, [[(f"×{symbol.name}", symbol.role)]], gap=1))
        elif len(here) > 1 and symbol.name:
            self._record(at, labels.place(at, spots, [[(symbol.name, symbol.role)]], most=_BESIDE))
