"""Draws what others report on the map: hollow, in grey, and only where there is nothing of ours.

Such a marker hides no other, moves no name and cannot be pointed at: no order means it.
"""

from collections.abc import Collection
from math import floor
from typing import NamedTuple

from rich.cells import cell_len

from pa_console.schema.events.session import ReportedContact
from pa_console.tui.map.canvas import FREE, Canvas, Cell, Spot
from pa_console.tui.map.labels import Labels
from pa_console.tui.map.projection import Projection
from pa_console.tui.map.symbols import edge_arrow

GLYPH, ROLE = "◌", "contact"
MOST_NAME = 14
"""A longer call sign is cut on the map; the event list has it whole."""

_FREE = FREE | {"wall"}


class _Drawn(NamedTuple):
    at: Cell
    spot: Spot
    contact: ReportedContact


class Contacts:
    """The contacts that are in sight; where `whole` is, those beyond it are at its edge."""

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
        """Draw each on an empty cell, and with `labels` its name if that hides nothing."""
        for at, (column, row), _ in self._drawn:
            if canvas.role(at) in _FREE:
                way = floor(column) - at[0], floor(row) - at[1]
                canvas.put(at, GLYPH if way == (0, 0) else edge_arrow(*way), ROLE)
        if labels is None or not self._drawn:
            return
        self._keep_what_is_there(canvas, labels)
        for at, spot, contact in self._drawn:
            hidden = "" if canvas.role(at) == ROLE else GLYPH
            name = f"{hidden}TAK {short_name(contact.name)}"
            for text in (f"{name} {contact.affiliation}?", name):
                if labels.place(at, [spot], [[(text, ROLE)]], gap=len(hidden)):
                    break

    def _keep_what_is_there(self, canvas: Canvas, labels: Labels) -> None:
        for row, roles in enumerate(canvas.roles):
            for column, role in enumerate(roles):
                if role not in FREE:
                    labels.keep((column, row))


def short_name(name: str) -> str:
    """Return `name` for a row of cells: short, and each of its characters one cell wide."""
    plain = "".join(each if cell_len(each) == 1 else "?" for each in name)
    return plain if len(plain) <= MOST_NAME else f"{plain[: MOST_NAME - 1]}…"
