"""The tables of an evaluation's report as text in aligned columns."""

from collections.abc import Sequence

from textual.content import Content

from pa_console.evaluation.statistics import Table
from pa_console.tui.status_words import NOTE, QUIET
from pa_console.tui.trace.rows import layout, row

_GAP = "  "
LEAST_TEXT = 14
"""Columns of text wrap down to this many cells before a table grows wider than the screen."""


def tables_text(tables: Sequence[Table], width: int) -> Content:
    """Return all tables, one below the other, in `width` cells as far as their numbers allow."""
    lines: list[Content] = []
    for table in tables:
        lines += layout([row("", (table.title, f"bold {NOTE}"))], width)
        lines += _grid(table, width)
        if table.note:
            lines += layout([row("", (table.note, QUIET))], width)
        lines.append(Content())
    return Content("\n").join(lines)


def _grid(table: Table, width: int) -> list[Content]:
    """Return heading, rule and rows; columns of numbers stay whole and are aligned right."""
    numeric = [table.numeric(index) for index in range(len(table.columns))]
    widths = _widths(table, numeric, width)
    heading = [piece.stylize(QUIET) for piece in _line(table.columns, widths, numeric)]
    rule = Content.styled(_GAP.join("─" * room for room in widths), "$faint")
    lines = [*heading, rule]
    for cells in table.rows:
        lines += _line(cells, widths, numeric)
    return lines


def _widths(table: Table, numeric: Sequence[bool], width: int) -> list[int]:
    """Return the cells of each column; the widest of text give way, titles of numbers wrap."""
    columns = list(zip(table.columns, *table.rows, strict=True))
    widths: list[int] = []
    for (title, *cells), right in zip(columns, numeric, strict=True):
        least = [Content(word).cell_length for word in title.split()] if right else []
        whole = [] if right else [Content(title).cell_length]
        widths.append(max([1, *least, *whole, *(Content(cell).cell_length for cell in cells)]))
    room = width - len(_GAP) * (len(widths) - 1)
    texts = [index for index, right in enumerate(numeric) if not right]
    while texts and sum(widths) > room:
        widest = max(texts, key=lambda index: widths[index])
        if widths[widest] <= LEAST_TEXT:
            break
        widths[widest] -= 1
    return widths


def _line(cells: Sequence[str], widths: Sequence[int], numeric: Sequence[bool]) -> list[Content]:
    """Return one row of cells, as many lines high as its highest cell."""
    wrapped = [Content(text).wrap(room) for text, room in zip(cells, widths, strict=True)]
    lines: list[Content] = []
    for number in range(max(map(len, wrapped), default=0)):
        parts: list[Content] = []
        for pieces, room, right in zip(wrapped, widths, numeric, strict=True):
            piece = pieces[number] if number < len(pieces) else Content()
            gap = Content(" " * max(0, room - piece.cell_length))
            parts.append(gap + piece if right else piece + gap)
        lines.append(Content(_GAP).join(parts).rstrip())
    return lines
