"""The figures of a report: the paper's Figs. 3 to 5 and Table I, the ablation and the stages."""

import io
import re
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from html import escape
from typing import TYPE_CHECKING, Literal, NamedTuple

from pa_console.evaluation.reporting.statistics import (
    HYBRID_BY_CATEGORY,
    MODELS,
    Quantity,
    Records,
    SuccessRate,
    ablated_models,
    by_model,
    comparable_runs,
    grouped,
    main_runs,
    published,
    spread,
)
from pa_console.evaluation.reporting.tables_judgement import (
    VerdictSource,
    confidence_and_success,
    confusion,
    reliability,
)
from pa_console.evaluation.reporting.tables_outcomes import (
    LATENCIES,
    STAGES,
    SuccessKind,
    stage_name,
    stage_seconds,
    success_rate,
    variants_of,
)
from pa_console.schema.text import visible

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.typing import RcKeyType

SUCCESS, LATENCY, JUDGE, ABLATION, FAILURES = (
    "Success", "Latency", "Judgements and refusals", "Ablation", "Failures and repair",
)  # fmt: skip
"""The sections of a report, in order."""

INK = "#1f2328"
"""Text and axes; in a page it becomes the colour of the page's own text."""

GRID = "#9aa4b0"
BLUE, ORANGE, GREEN, VERMILION, SKY, PURPLE, YELLOW = (
    "#0072B2", "#E69F00", "#009E73", "#D55E00", "#56B4E9", "#CC79A7", "#F0E442",
)  # fmt: skip
"""The colours of Okabe and Ito (2008), which colour-blind readers can distinguish."""

SERIES = (BLUE, ORANGE, GREEN, PURPLE, SKY, VERMILION, YELLOW)
HATCHES = ("", "//", "..", "xx", "--", "\\\\", "oo")
"""Patterns beside the colours, for prints without any."""


class Drawn(NamedTuple):
    """A figure of a report: `name` is that of its file, `alt` its description in words."""

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
    return text.replace("<svg", f'<svg role="img" aria-label="{escape(drawn.alt)}"', 1)


Interval = tuple[float, float, float]
"""A value with the two ends of its interval."""

GROUP_WIDTH = 0.84


class Series(NamedTuple):
    """The bars of one colour, one a group; None where there is nothing to show."""

    label: str
    colour: str
    hatch: str
    values: Sequence[Interval | None]


def percent_interval(rate: SuccessRate) -> Interval | None:
    """Return a rate and its interval in percent, None without any run."""
    if rate.value is None:
        return None
    return 100 * rate.value, 100 * rate.low, 100 * rate.high


def draw_bars(ax: "Axes", series: Sequence[Series], slots: int = 0) -> None:
    """Draw bars with error bars, in groups around x = 0, 1, ...

    A group has room for `slots` bars, by default one for each of `series`.
    """
    slots = max(slots, len(series), 1)
    width = 0.92 * GROUP_WIDTH / slots
    for place, (label, colour, hatch, values) in enumerate(series):
        known = [(x, value) for x, value in enumerate(values) if value is not None]
        at = [x + slot_offset(place, slots) for x, _ in known]
        heights = [value for _, (value, _, _) in known]
        ax.bar(
            at, heights, width, color=colour, hatch=hatch, edgecolor=INK, linewidth=0.5, label=label
        )
        below = [value - low for _, (value, low, _) in known]
        above = [high - value for _, (value, _, high) in known]
        ax.errorbar(
            at, heights, [below, above], fmt="none", ecolor=INK, elinewidth=0.9, capsize=2.5
        )


def slot_offset(place: int, slots: int) -> float:
    """Return how far from the middle of its group the bar in slot `place` stands."""
    return (place - (slots - 1) / 2) * GROUP_WIDTH / slots


def draw_paper_mark(ax: "Axes", x: float, value: float, colour: str, text: str = "") -> None:
    """Draw a value of the paper: a hollow ring, `text` beside it."""
    ax.plot([x], [value], "o", mfc="none", mec=colour, mew=1.8, ms=7.5, zorder=5)
    if text:
        ax.annotate(text, (x, value), (5, 3), textcoords="offset points", fontsize=7)


def draw_paper_letter(ax: "Axes", x: float, value: float, letter: str) -> None:
    """Draw a value of the paper as the first letter of its model in a hollow ring."""
    ax.plot([x], [value], "o", mfc="none", mec=INK, mew=0.8, ms=8.5, zorder=5, clip_on=False)
    ax.annotate(letter, (x, value), ha="center", va="center", fontsize=6, annotation_clip=False)


def name_paper(ax: "Axes", label: str) -> None:
    """Put the hollow ring of the paper's values into the legend of `ax`."""
    ax.plot([], [], "o", mfc="none", mec=INK, mew=1.5, ms=7, label=label)


def legend(figure: "Figure", ax: "Axes", columns: int) -> None:
    """Show the legend of `ax` above all axes of `figure`, the paper's ring last."""
    found = list(zip(*ax.get_legend_handles_labels(), strict=True))
    found.sort(key=lambda entry: entry[1].startswith("paper"))
    if found:
        handles, labels = zip(*found, strict=True)
        figure.legend(handles, labels, loc="outside upper left", ncols=columns, fontsize=8)


def label_groups(ax: "Axes", labels: Sequence[str], ours: int) -> None:
    """Name the groups; those after the first `ours` are the paper's, behind a thin line."""
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
    """Return a long name on two lines, broken at a hyphen or a space near its middle."""
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


SHOWN = {"decision": (SKY, ""), "end to end, station": (BLUE, "//")}
"""The latencies that are drawn; simulated execution would dwarf them."""

LEAST_SHARE = 0.01
"""Stages that take no more than this of the whole, for every model, are drawn as one."""

REST = "the rest, 1% or less each"


def figure_four(records: Records, beside: bool) -> "Figure":
    """Draw mean latencies by model; `beside` adds the latencies in the paper's text."""
    models = by_model(records)
    theirs = [m for m in MODELS if beside and published(m, "latency_s") is not None]
    figure, (ax,) = new_figure(7.2, 3.4)
    series = [
        Series(name, colour, hatch, [_mean(runs, name) for runs in models.values()])
        for name, (colour, hatch) in SHOWN.items()
    ]
    draw_bars(ax, series)
    for number, model in enumerate(theirs):
        value = published(model, "latency_s")
        if value is not None:
            at = len(models) + number + slot_offset(1, len(SHOWN))
            draw_paper_mark(ax, at, value.value, BLUE, f"{value.value:.2f} s")
    label_groups(ax, [*models, *(MODELS[m] for m in theirs)], len(models))
    ax.set_ylim(bottom=0)
    ax.set_ylabel("mean seconds a run")
    if theirs:
        name_paper(ax, "paper, end to end")
    legend(figure, ax, 3)
    return figure


def _mean(records: Records, name: str) -> Interval | None:
    found = spread([LATENCIES[name](record) for record in records])
    if found is None:
        return None
    return found.mean, max(found.mean - found.margin, 0.0), found.mean + found.margin


def stages(records: Records) -> "Figure":
    """Draw the mean seconds of each stage as one stacked bar a model."""
    models = by_model(records)
    means = {
        stage: [sum(stage_seconds(r, stage) for r in runs) / len(runs) for runs in models.values()]
        for stage in STAGES
    }
    whole = [sum(column) for column in zip(*means.values(), strict=True)]

    def small(stage: str) -> bool:
        pairs = zip(means[stage], whole, strict=True)
        return all(part <= LEAST_SHARE * total for part, total in pairs)

    parts = {stage_name(stage): means[stage] for stage in STAGES if not small(stage)}
    rest = [stage for stage in STAGES if small(stage)]
    if rest:
        sums = [sum(column, 0.0) for column in zip(*(means[stage] for stage in rest), strict=True)]
        parts[REST] = sums
    figure, (ax,) = new_figure(7.2, 1.3 + 0.45 * len(models))
    places = range(len(models))
    left: list[float] = [0.0] * len(models)
    for number, (name, values) in enumerate(parts.items()):
        colour = GRID if name == REST else SERIES[number % len(SERIES)]
        hatch = "" if name == REST else HATCHES[number % len(HATCHES)]
        ax.barh(
            places, values, 0.62, left,
            color=colour, hatch=hatch, edgecolor=INK, linewidth=0.5, label=name,
        )  # fmt: skip
        left = [start + value for start, value in zip(left, values, strict=True)]
    ax.set_yticks(list(places), list(models))
    ax.tick_params(axis="y", length=0)
    ax.invert_yaxis()
    ax.set_xlabel("mean seconds a run, simulated execution left out")
    ax.grid(visible=False, axis="y")
    ax.grid(axis="x")
    legend(figure, ax, 5)
    return figure


SCORES: dict[SuccessKind, tuple[str, str, str]] = {
    "hybrid": (SKY, "", "hybrid"),
    "strict": (BLUE, "", "strict"),
    "obeyed": (ORANGE, "//", "strict if the judge is obeyed"),
}
"""Colour, pattern and name of each kind of success."""

QUANTITIES: dict[Quantity, tuple[str, str]] = {
    "precision": (BLUE, ""),
    "recall": (ORANGE, "//"),
    "f1": (GREEN, ".."),
}


def figure_three(records: Records, beside: bool) -> "Figure":
    """Draw overall success by model; `beside` adds the paper's models on the right."""
    models = by_model(records)
    theirs = list(MODELS) if beside else []
    figure, (ax,) = new_figure(7.2, 3.6)
    draw_bars(
        ax,
        [
            Series(
                label,
                colour,
                hatch,
                [percent_interval(success_rate(runs, name)) for runs in models.values()],
            )
            for name, (colour, hatch, label) in SCORES.items()
        ],
    )
    colours: dict[Quantity, str] = {"hybrid": SCORES["hybrid"][0], "strict": SCORES["strict"][0]}
    _mark_rates(ax, theirs, len(models), colours, len(SCORES))
    label_groups(ax, [*models, *(MODELS[m] for m in theirs)], len(models))
    percent_axis(ax, "successful runs, %")
    if theirs:
        name_paper(ax, "paper (* follows from its Table I)")
    legend(figure, ax, 4)
    return figure


def _mark_rates(
    ax: "Axes", theirs: list[str], ours: int, colours: Mapping[Quantity, str], slots: int
) -> None:
    """Mark the rates of the models `theirs` after `ours` groups, with a star where derived."""
    for number, model in enumerate(theirs):
        for place, (quantity, colour) in enumerate(colours.items()):
            value = published(model, quantity)
            if value is not None:
                at = ours + number + slot_offset(place, slots)
                draw_paper_mark(ax, at, 100 * value.value, colour, "*" * value.derived)


def table_one(records: Records, beside: bool) -> "Figure":
    """Draw hybrid and strict success by category, the paper's values as letters in rings."""
    models = by_model(records)
    categories = grouped(records, lambda record: record.category)
    theirs = [model for model in MODELS if beside]
    slots = len(models) + len(theirs)
    figure, axes = new_figure(7.2, 5.4, rows=2)
    names: tuple[Literal["hybrid", "strict"], ...] = ("hybrid", "strict")
    for ax, name in zip(axes, names, strict=True):
        series = [
            Series(
                model,
                SERIES[number % len(SERIES)],
                HATCHES[number % len(HATCHES)],
                [
                    percent_interval(
                        success_rate([run for run in runs if run.model == model], name)
                    )
                    for runs in categories.values()
                ],
            )
            for number, model in enumerate(models)
        ]
        shown = slots if name == "hybrid" else len(models)
        draw_bars(ax, series, shown)
        label_groups(ax, list(categories), len(categories))
        percent_axis(ax, f"{name} success, %")
        if name == "hybrid":
            _mark_categories(ax, list(categories), theirs, len(models))
            if theirs:
                words = ", ".join(f"{model[0]} {model}" for model in theirs)
                name_paper(ax, f"paper: {words}")
            legend(figure, ax, 3)
    return figure


def _mark_categories(ax: "Axes", categories: list[str], theirs: list[str], ours: int) -> None:
    for x, category in enumerate(categories):
        values = HYBRID_BY_CATEGORY.get(category, {})
        for number, model in enumerate(theirs):
            if model in values:
                at = x + slot_offset(ours + number, ours + len(theirs))
                draw_paper_letter(ax, at, 100 * values[model], model[0])


def figure_five(records: Records, beside: bool) -> "Figure":
    """Draw precision, recall and F1 of the judge before and after execution."""
    models = by_model(records)
    theirs = [m for m in MODELS if beside and any(published(m, q) for q in QUANTITIES)]
    figure, axes = new_figure(7.2, 5.4, rows=2)
    judgements: tuple[VerdictSource, ...] = ("judge, plan", "judge, outcome")
    titles = ("before execution: verdict on the plan", "after execution: verdict on the outcome")
    for ax, judgement, title in zip(axes, judgements, titles, strict=True):
        found = [confusion(runs, judgement) for runs in models.values()]
        values = {
            "precision": [percent_interval(one.precision) for one in found],
            "recall": [percent_interval(one.recall) for one in found],
            "f1": [
                None if one.f1 is None else (100 * one.f1[0], 100 * one.f1[1], 100 * one.f1[2])
                for one in found
            ],
        }
        series = [
            Series("F1" if name == "f1" else name, colour, hatch, values[name])
            for name, (colour, hatch) in QUANTITIES.items()
        ]
        draw_bars(ax, series)
        shown = theirs if judgement == "judge, outcome" else []
        colours: dict[Quantity, str] = {name: pair[0] for name, pair in QUANTITIES.items()}
        _mark_rates(ax, shown, len(models), colours, len(colours))
        label_groups(ax, [*models, *(MODELS[m] for m in shown)], len(models))
        percent_axis(ax, "%")
        ax.set_title(title, loc="left", fontsize=9)
        if shown:
            name_paper(ax, "paper (* follows from the other two)")
        if judgement == "judge, outcome":
            legend(figure, ax, 4)
    return figure


def ablation(records: Records) -> "Figure":
    """Draw the success of each variant of one model as dots with intervals, reference on top."""
    variants = variants_of(records)
    figure, (ax,) = new_figure(7.2, 1.1 + 0.42 * len(variants))
    places = range(len(variants))
    shapes = {"hybrid": "s", "strict": "o", "obeyed": "^"}
    for number, (name, (colour, _, label)) in enumerate(SCORES.items()):
        rates = [success_rate(runs, name) for runs in variants.values()]
        shown = [
            (place, *value)
            for place, r in zip(places, rates, strict=True)
            if (value := percent_interval(r)) is not None
        ]
        ax.errorbar(
            [value for _, value, _, _ in shown],
            [place + (number - 1) * 0.22 for place, *_ in shown],
            xerr=[[v - low for _, v, low, _ in shown], [high - v for _, v, _, high in shown]],
            fmt=shapes[name], color=colour, ecolor=colour, label=label,
            ms=5.5, mec=INK, mew=0.4, elinewidth=1.4, capsize=2,
        )  # fmt: skip
    reference = success_rate(next(iter(variants.values())), "strict").value or 0.0
    ax.axvline(100 * reference, color=BLUE, linewidth=0.8, linestyle="--", zorder=0)
    ax.set_yticks(list(places), list(variants))
    ax.set_ylim(len(variants) - 0.5, -0.5)
    ax.set_xlim(-2, 102)
    ax.set_xlabel("successful runs, % (dashed: strict success of the reference)")
    ax.grid(axis="x")
    legend(figure, ax, 3)
    return figure


def reliability_diagram(records: Records) -> "Figure":
    """Draw strict success against confidence, a line for every model, with 95 % intervals."""
    figure, (ax,) = new_figure(4.6, 4.0)
    ax.plot([0, 100], [0, 100], color=INK, linewidth=0.8, linestyle="--", label="as sure as right")
    shapes = "os^Dv"
    for number, (model, runs) in enumerate(by_model(main_runs(records)).items()):
        bins = reliability(confidence_and_success(runs))
        points = [
            (100 * found.confidence, *interval)
            for found in bins
            if (interval := percent_interval(found.strict)) is not None
        ]
        colour = SERIES[number % len(SERIES)]
        ax.errorbar(
            [x for x, *_ in points],
            [y for _, y, _, _ in points],
            yerr=[[y - low for _, y, low, _ in points], [high - y for _, y, _, high in points]],
            fmt=f"{shapes[number % len(shapes)]}-", color=colour, ecolor=colour, label=model,
            ms=5.0, mec=INK, mew=0.4, linewidth=1.0, elinewidth=1.0, capsize=2,
        )  # fmt: skip
    ax.set_xlim(-4, 104)
    ax.set_xlabel("confidence, %")
    percent_axis(ax, "strict success, %")
    ax.grid(axis="x", color=GRID)
    legend(figure, ax, 3)
    return figure


def build_figures(records: Records) -> list[Drawn]:
    """Return the figures that `records` give, none of them drawn yet; none for no records.

    Figs. 3 to 5 and Table I show the paper's missions when they were run, all others otherwise.
    """
    main, paper = main_runs(records), comparable_runs(records)
    if not main:
        return []
    shown, beside = paper or main, bool(paper)
    figures = [
        Drawn(
            SUCCESS,
            "figure-3",
            "Fig. 3: overall success by model",
            "Bars of hybrid and strict success by model with 95 % intervals.",
            partial(figure_three, shown, beside),
        ),
        Drawn(
            SUCCESS,
            "table-1",
            "Table I: success by scenario category and model",
            "Bars of hybrid and of strict success by category and model with 95 % intervals.",
            partial(table_one, shown, beside),
        ),
        Drawn(
            LATENCY,
            "figure-4",
            "Fig. 4: latency by model",
            "Bars of the mean decision and end-to-end latency by model.",
            partial(figure_four, shown, beside),
        ),
        Drawn(
            LATENCY,
            "stages",
            "Latency by stage",
            "Stacked bars of the mean seconds of each stage by model.",
            partial(stages, main),
        ),
        Drawn(
            JUDGE,
            "figure-5",
            "Fig. 5: the judge against the truth",
            "Bars of precision, recall and F1 of the judge by model with 95 % intervals.",
            partial(figure_five, shown, beside),
        ),
    ]
    if confidence_and_success(main):
        figures.append(
            Drawn(
                JUDGE,
                "reliability",
                "Calibration: success by confidence",
                "Strict success of the runs of each tenth of confidence by model, beside the "
                "diagonal on which confidence says how often an order is understood.",
                partial(reliability_diagram, main),
            )
        )
    for number, model in enumerate(ablated_models(records), start=1):
        runs = [record for record in records if record.model == model]
        figures.append(
            Drawn(
                ABLATION,
                f"ablation-{number}",
                f"Ablation: success by variant ({model})",
                "Dots of strict, obeyed and hybrid success by variant with 95 % intervals.",
                partial(ablation, runs),
            )
        )
    return figures
