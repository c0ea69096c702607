"""What a terminal shows after it was sent text with the few sequences that the console uses."""

import re

from rich.cells import cell_len

Cells = dict[tuple[int, int], tuple[str, str]]
"""Character and colours by row and column, both from 1."""

_TOKEN = re.compile(
    r"\x1b\][^\x07]*\x07|\x1b\[(?P<values>[\d;?]*)(?P<final>[A-Za-z])|(?P<text>[^\x1b])"
)


def screen(written: str) -> Cells:
    """Return the cells of the screen after all that was `written` to it."""
    cells: Cells = {}
    row, column, style = 1, 1, ""
    for token in _TOKEN.finditer(written):
        match token["final"], token["text"]:
            case "H", _:
                row, column = map(int, token["values"].split(";"))
            case "m", _:
                style = "" if token["values"] in ("", "0") else f"{style};{token['values']}"
            case "J", _:
                cells.clear()
            case None, "\n" | "\r":
                row, column = row + (token["text"] == "\n"), 1
            case None, str(text):
                cells[row, column] = text, style
                column += cell_len(text)
            case _:
                pass
    return cells


def painted(written: str) -> int:
    """Return how many characters of `written` went to the screen."""
    return sum(token["text"] not in (None, "\n", "\r") for token in _TOKEN.finditer(written))
