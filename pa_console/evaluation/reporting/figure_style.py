"""How the figures look, and how they are written: to read on paper, on light and on dark ground."""

import io
import re
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import TYPE_CHECKING, NamedTuple

from pa_console.schema.visible import visible

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.typing import RcKeyType

INK = "#1f2328"
"""Text and axes; in a page it becomes the colour of the page's own text."""

GRID = "#9aa4b0"
BLUE, ORANGE, GREEN, VERMILION, SKY, PURPLE, YELLOW = (
    "#0072B2", "#E69F00", "#009E73", "#D55E00", "#56B4E9", "#CC79A7", "#F0E442",
)  # fmt: skip
"""The colours of Okabe and Ito (2008), which colour-blind readers can tell apart."""

SERIES = (BLUE, ORANGE, GREEN, PURPLE, SKY, VERMILION, YELLOW)
HATCHES = ("", "//", "..", "xx", "--", "\\\\", "oo")
"""Patterns beside the colours, for prints without any."""


class Drawn(NamedTuple):
    """A figure of a report: `name` is its file's, `alt` says in words what it shows."""

    section: str
    name: str
    title: str
    alt: str
    draw: Callable[[], "Figure"]


@contextmanager
def _settings(name: str) -> Generator[None]:
    """Draw with the fonts and colours of the reports, ids and text the same every time."""
    import matplotlib as mpl  # noqa: PLC0415 - loading it takes a second

    settings: dict[RcKeyType, str | float | bool] = {
        "font.family": "sans-serif",
        "font.size": 9.0,
        "text.parse_math": False,
        "svg.fonttype": "none",
        "svg.hashsalt": name,
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
    with mpl.rc_context(settings):
        yield


def new_figure(width: float, height: float, rows: int = 1) -> "tuple[Figure, list[Axes]]":
    """Return a figure of `width` x `height` inches with `rows` axes below one another.

    It belongs to no window and to no global list of figures.
    """
    from matplotlib.figure import Figure  # noqa: PLC0415

    figure = Figure(figsize=(width, height), layout="constrained")
    axes = [figure.add_subplot(rows, 1, row + 1) for row in range(rows)]
    for ax in axes:
        ax.grid(axis="y")
    return figure, axes


def render(drawn: Drawn) -> tuple[bytes, bytes]:
    """Return `drawn` as SVG on white ground, and as PNG of 150 dots an inch."""
    with _settings(drawn.name):
        figure = drawn.draw()
        svg, png = io.BytesIO(), io.BytesIO()
        figure.savefig(svg, format="svg", metadata={"Date": None, "Creator": None})
        figure.savefig(png, format="png", dpi=150, metadata={"Software": None})
    return visible(svg.getvalue().decode()).encode(), png.getvalue()


def inline(svg: bytes, drawn: Drawn) -> str:
    """Return an SVG for a page: no prolog, no ground, text in the page's colour, named for readers.

    Ids that nothing refers to are left out, as several figures of a page would share them.
    """
    text = svg.decode()
    text = text[text.index("<svg") :]
    text = re.sub(r"\s*<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r'\s*<g id="patch_1">.*?</g>', "", text, count=1, flags=re.DOTALL)
    used = set(re.findall(r"#([\w.-]+)", text))
    text = re.sub(r' id="([\w.-]+)"', lambda m: m[0] if m[1] in used else "", text)
    text = text.replace(INK, "currentColor")
    text = re.sub(r' (width|height)="[\d.]+pt"', "", text, count=2)
    return text.replace("<svg", f'<svg role="img" aria-label="{_attribute(drawn.alt)}"', 1)


def _attribute(text: str) -> str:
    return text.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
