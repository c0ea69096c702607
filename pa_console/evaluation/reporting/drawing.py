"""The axes, bars and marks of the figures in a report, and the files of the figures."""

import io
import re
from collections.abc import Callable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any, NamedTuple

from pa_console.evaluation.reporting.statistics import Interval, SuccessRate
from pa_console.schema.text import visible

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.typing import RcKeyType

INK = "#1f2328"
"""The colour of text and axes, which a page replaces by the colour of its own text."""

GRID = "#9aa4b0"
BLUE, ORANGE, GREEN, VERMILION, SKY, PURPLE, YELLOW = (
    "#0072B2", "#E69F00", "#009E73", "#D55E00", "#56B4E9", "#CC79A7", "#F0E442",
)  # fmt: skip
"""The colours of Okabe and Ito (2008), which colour-blind readers can tell apart."""

SERIES = (BLUE, ORANGE, GREEN, PURPLE, SKY, VERMILION, YELLOW)
HATCHES = ("", "//", "..", "xx", "--", "\\\\", "oo")
"""The patterns of the series, for prints without colours."""

SETTINGS: "dict[RcKeyType, str | float | bool]" = {
    "font.family": "sans-serif",
    "font.size": 9.0,
    "text.parse_math": False,
    "svg.fonttype": "none",
    "text.color": INK,
    "axes.facecolor": "none",
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.alpha": 0.4,
    "grid.linewidth": 0.6,
    "hatch.linewidth": 0.5,
    "legend.frameon": False,
}
"""The fonts and colours of every figure."""

GROUP_WIDTH = 0.84
"""The width of a group of bars, if the distance between the middles of two groups is 1."""


class Style(NamedTuple):
    """The label, colour and pattern of a quantity."""

    label: str
    colour: str
    hatch: str = ""


def new_figure(width: float, height: float, rows: int = 1) -> "tuple[Figure, list[Axes]]":
    """Return a figure of `width` x `height` inches with `rows` axes, one below the other.

    The figure has no window and is not in matplotlib's global list of figures.
    """
    from matplotlib.figure import Figure  # noqa: PLC0415

    figure = Figure(figsize=(width, height), layout="constrained")
    axes = [figure.add_subplot(rows, 1, row + 1) for row in range(rows)]
    for ax in axes:
        ax.grid(axis="y")
    return figure, axes


def render(name: str, draw: Callable[[], "Figure"]) -> tuple[bytes, bytes]:
    """Return a figure as SVG, and as PNG with 150 dots per inch.

    `name` is the salt for the hashed ids in the SVG, so that equal figures have equal ids.
    """
    import matplotlib as mpl  # noqa: PLC0415 - loading it takes a second

    with mpl.rc_context({**SETTINGS, "svg.hashsalt": name}):
        figure = draw()
        svg, png = io.BytesIO(), io.BytesIO()
        figure.savefig(svg, format="svg", metadata={"Date": None, "Creator": None})
        figure.savefig(png, format="png", dpi=150, metadata={"Software": None})
    return visible(svg.getvalue().decode()).encode(), png.getvalue()


def inline(svg: bytes, alt: str) -> str:
    """Return an SVG without prolog and background, in the page's text colour, and with a label.

    `alt` is the label for screen readers. Ids without references are removed, because otherwise
    several figures on a page could have the same ids.
    """
    text = svg.decode()
    text = text[text.index("<svg") :]
    text = re.sub(r"\s*<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r'\s*<g id="patch_1">.*?</g>', "", text, count=1, flags=re.DOTALL)
    used = set(re.findall(r"#([\w.-]+)", text))
    text = re.sub(r' id="([\w.-]+)"', lambda m: m[0] if m[1] in used else "", text)
    text = text.replace(INK, "currentColor")
    text = re.sub(r' (width|height)="[\d.]+pt"', "", text, count=2)
    return text.replace("<svg", f'<svg role="img" aria-label="{escape(alt)}"', 1)


def percent_interval(rate: SuccessRate) -> Interval | None:
    """Return a rate and its interval in percent; None if there are no runs."""
    return None if rate.value is None else percents((rate.value, rate.low, rate.high))


def percents(shares: Interval) -> Interval:
    """Return shares as percentages."""
    value, low, high = shares
    return 100 * value, 100 * low, 100 * high


def series_style(number: int, label: str) -> Style:
    """Return the style of the series with the number `number`, and the label `label`."""
    return Style(label, SERIES[number % len(SERIES)], HATCHES[number % len(HATCHES)])


def draw_bars(
    ax: "Axes", series: Mapping[Style, Sequence[Interval | None]], slots: int = 0
) -> None:
    """Draw the values of each style as bars with error bars, in groups around x = 0, 1, ...

    A value of None leaves a gap. A group has room for `slots` bars, or by default for one bar of
    each series.
    """
    slots = max(slots, len(series), 1)
    width = 0.92 * GROUP_WIDTH / slots
    for place, (style, values) in enumerate(series.items()):
        points = [
            (x + slot_offset(place, slots), *value)
            for x, value in enumerate(values)
            if value is not None
        ]
        at, heights = [x for x, *_ in points], [value for _, value, *_ in points]
        ax.bar(
            at, heights, width, color=style.colour, hatch=style.hatch, edgecolor=INK,
            linewidth=0.5, label=style.label,
        )  # fmt: skip
        ax.errorbar(
            at, heights, error_lengths(points), fmt="none", ecolor=INK, elinewidth=0.9, capsize=2.5
        )


def error_lengths(points: Sequence[tuple[float, float, float, float]]) -> list[list[float]]:
    """Return the lengths of the error bars below and above `points` (place, value, low, high)."""
    return [
        [value - low for _, value, low, _ in points],
        [high - value for _, value, _, high in points],
    ]


def slot_offset(place: int, slots: int) -> float:
    """Return the distance of the bar in slot `place` from the middle of its group."""
    return (place - (slots - 1) / 2) * GROUP_WIDTH / slots


def draw_paper_mark(ax: "Axes", x: float, value: float, colour: str, text: str = "") -> None:
    """Draw a value of the paper as a hollow ring with `text` beside it."""
    ax.plot([x], [value], "o", mfc="none", mec=colour, mew=1.8, ms=7.5, zorder=5)
    if text:
        ax.annotate(text, (x, value), (5, 3), textcoords="offset points", fontsize=7)


def draw_paper_letter(ax: "Axes", x: float, value: float, letter: str) -> None:
    """Draw a value of the paper as the first letter of its model in a hollow ring."""
    ax.plot([x], [value], "o", mfc="none", mec=INK, mew=0.8, ms=8.5, zorder=5, clip_on=False)
    ax.annotate(letter, (x, value), ha="center", va="center", fontsize=6, annotation_clip=False)


def name_paper(ax: "Axes", label: str) -> None:
    """Add the hollow ring of the paper's values to the legend of `ax`."""
    ax.plot([], [], "o", mfc="none", mec=INK, mew=1.5, ms=7, label=label)


def legend(figure: "Figure", ax: "Axes", columns: int) -> None:
    """Draw the legend of `ax` above all axes of `figure`, with the paper's ring last."""
    entries = list(zip(*ax.get_legend_handles_labels(), strict=True))
    entries.sort(key=lambda entry: entry[1].startswith("paper"))
    if entries:
        handles, labels = zip(*entries, strict=True)
        figure.legend(handles, labels, loc="outside upper left", ncols=columns, fontsize=8)


def label_groups(ax: "Axes", labels: Sequence[str], ours: int) -> None:
    """Label the groups; groups after the first `ours` are the paper's, beyond a thin line."""
    names = [
        _broken(label) if place < ours else f"{_broken(label)}\n(paper)"
        for place, label in enumerate(labels)
    ]
    ax.set_xticks(range(len(labels)), names, fontsize=8)
    ax.tick_params(axis="x", length=0)
    spare = max(3 - len(labels), 0) / 2
    ax.set_xlim(-0.6 - spare, len(labels) - 0.4 + spare)
    if ours < len(labels):
        ax.axvline(ours - 0.5, color=GRID, linewidth=1, linestyle=":")


def _broken(label: str) -> str:
    """Return a long name in two lines, divided at the hyphen or space closest to its middle."""
    if len(label) <= 11:
        return label
    cuts = [place + 1 for place, sign in enumerate(label) if sign in "- "]
    if not cuts:
        return label
    cut = min(cuts, key=lambda place: abs(place - len(label) / 2))
    return f"{label[:cut].rstrip(' ')}\n{label[cut:]}"


def percent_axis(ax: "Axes", label: str) -> None:
    """Scale the y axis from 0 to 100 percent, with room for marks at both ends."""
    ax.set_ylim(-4, 106)
    ax.set_yticks(range(0, 101, 20))
    ax.set_ylabel(label)


def draw_dots(
    ax: "Axes",
    points: Sequence[tuple[float, float, float, float]],
    label: str,
    colour: str,
    *,
    upright: bool,
    **options: Any,
) -> None:
    """Draw `points` (place, value, low, high) with error bars, which are vertical if `upright`."""
    places, values = [place for place, *_ in points], [value for _, value, *_ in points]
    lengths = error_lengths(points)
    error = {"yerr": lengths} if upright else {"xerr": lengths}
    x, y = (places, values) if upright else (values, places)
    ax.errorbar(
        x, y, **error, color=colour, ecolor=colour, label=label, mec=INK, mew=0.4, capsize=2,
        **options,
    )  # fmt: skip
