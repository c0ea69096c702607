"""A table of results as plain data, and how its cells are written."""

import re

from pydantic import model_validator

from pa_console.evaluation.reporting.statistics import Rate
from pa_console.schema.base import StrictModel

NOTHING = "-"
"""The cell of a value that there is not."""

_NUMBER = re.compile(r"[+-]?\d[\d.,]*[%*/]{0,2}( |\d|$)|-$")


class Table(StrictModel):
    """Rows of text under column titles; `name` is unique in a report, `note` explains it."""

    name: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""

    @model_validator(mode="after")
    def _full_rows(self) -> "Table":
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"{self.name}: {len(row)} cells under {len(self.columns)} titles")
        return self

    def numeric(self, column: int) -> bool:
        """Return whether every cell of `column` is a number, a rate or nothing."""
        return column > 0 and all(_NUMBER.match(row[column]) for row in self.rows)


def percent(share: float | None) -> str:
    """Write a share as a percentage."""
    return NOTHING if share is None else f"{100 * share:.0f}%"


def rate_cell(rate: Rate) -> str:
    """Write a rate as `83% (71-91) 40/48`: value, 95 % Wilson interval, successes and runs."""
    if not rate.runs:
        return NOTHING
    interval = f"({100 * rate.low:.0f}–{100 * rate.high:.0f})"
    return f"{percent(rate.value)} {interval} {rate.successes}/{rate.runs}"


def fraction_cell(value: tuple[float, float, float] | None) -> str:
    """Write a value between 0 and 1 and its interval as `0.83 (0.71-0.91)`."""
    return NOTHING if value is None else "{:.2f} ({:.2f}–{:.2f})".format(*value)


def seconds(value: float | None) -> str:
    """Write seconds with about three digits, so that milliseconds stay distinct."""
    if value is None:
        return NOTHING
    digits = 3 if value < 0.1 else 2 if value < 10 else 1
    return f"{value:.{digits}f}"
