"""How many rows of the terminal the approval panel may take, and the plan in it."""

from typing import NamedTuple

ROWS_ELSEWHERE = 6
"""The lines of the terminal that are neither map nor panel, about."""

WIDE_SHARE, COMPACT_SHARE = 0.7, 0.62
"""How much of the other lines the panel may take, beside the map and below it."""

LEAST_ROWS, LEAST_PLAN_ROWS = 13, 4


class PanelRoom(NamedTuple):
    """So many rows at most: for the whole panel, and for the plan in it."""

    panel: int
    plan: int


def panel_room(terminal: int, taken: int, *, compact: bool) -> PanelRoom:
    """Return the room in a terminal of so many rows, of which the panel's other parts have `taken`.

    `compact` says that the panel stands below the map and not beside it.
    """
    share = int((terminal - ROWS_ELSEWHERE) * (COMPACT_SHARE if compact else WIDE_SHARE))
    most = max(share, LEAST_ROWS, taken + LEAST_PLAN_ROWS)
    return PanelRoom(most, most - taken)
