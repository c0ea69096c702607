"""Shows a table of results in the terminal."""

from rich import box
from rich.table import Table as RichTable
from rich.text import Text

from pa_console.evaluation.reporting.table import Table

_GAP = 2
"""Characters between two columns."""

_TITLE_WORD = 9
"""Longer words of a column's title may be broken; names of models are long."""


def to_rich(table: Table, width: int = 100) -> RichTable:
    """Return `table`, without its note, for a terminal of `width` columns; long cells wrap.

    Every column gets a width of its own, so that ids and intervals stay whole as long as there is
    room for all of them.
    """
    shown = RichTable(
        title=Text(table.title, style="bold"),
        title_justify="left",
        box=box.SIMPLE_HEAD,
        show_edge=False,
        pad_edge=False,
        padding=(0, 1, 0, 0),
    )
    for index, wide in enumerate(_widths(table, width)):
        justify = "right" if table.numeric(index) else "left"
        title = Text(table.columns[index])
        shown.add_column(title, justify=justify, overflow="fold", width=wide)
    for row in table.rows:
        shown.add_row(*map(Text, row))
    return shown


def _widths(table: Table, width: int) -> list[int]:
    """Return a width for each column: its longest word, then what is left to the neediest."""
    room = max(width - _GAP * len(table.columns), len(table.columns))
    cells = [list(column) for column in zip(table.columns, *table.rows, strict=True)]
    whole = [max(len(cell) for cell in column) or 1 for column in cells]
    found = [
        max(
            max((len(word) for cell in column[1:] for word in cell.split()), default=1),
            *(min(len(word), _TITLE_WORD) for word in column[0].split()),
        )
        for column in cells
    ]
    while sum(found) > room:
        found[found.index(max(found))] -= 1
    while sum(found) < min(room, sum(whole)):
        need = [full / here for full, here in zip(whole, found, strict=True)]
        found[need.index(max(need))] += 1
    return found
