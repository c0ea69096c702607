"""The tables of `pa-console bench`, one a part."""

from collections.abc import Sequence

from rich.table import Table
from rich.text import Text

from pa_console.evaluation.bench.compare import Comparison, Unit, Way
from pa_console.evaluation.bench.parts import Part

LEGEND = (
    "ratio: how many times better ours is: the other's time or memory by ours, or our tokens a "
    "second by the other's. Above 1 ours is better; against a limit, what is below 1 is the share "
    "of it that is reached."
)

_UNITS = ((1.0, "s", 1.0), (1e-3, "ms", 1e3), (0.0, "µs", 1e6))
"""(from this many seconds on, unit, units a second)."""

_SHORT: dict[Unit, str] = {"tokens/s": "t/s", "MB": "MB"}


def part_table(part: Part, comparisons: Sequence[Comparison]) -> Table:
    """Return the table of one part; a note stands under the line that it belongs to."""
    table = Table(title=part.about, title_justify="left")
    table.add_column("what", ratio=3)
    for name in ("ours", "other", "ratio"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("the other way", ratio=2)
    for line in comparisons:
        name = Text(line.name)
        if line.note:
            name.append(f"\n{line.note}", style="dim")
        table.add_row(
            name,
            _figure(line.ours, line.unit),
            "" if line.other is None else _figure(line.other, line.unit),
            "" if line.ratio is None else f"{line.ratio:.3g}x",
            Text("a cost, with nothing beside it" if line.other is None else line.other.what),
        )
    return table


def _figure(way: Way, unit: Unit) -> str:
    if unit != "s":
        return f"{way.median:,.1f} {_SHORT[unit]}"
    size, factor = next((name, by) for least, name, by in _UNITS if way.median >= least)
    return f"{way.median * factor:.3g} {size}"
