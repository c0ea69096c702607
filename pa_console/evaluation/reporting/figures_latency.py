"""Figures of latency: Fig. 4 with the paper's values, and where the time goes."""

from typing import TYPE_CHECKING

from pa_console.evaluation.reporting.figure_bars import (
    Interval,
    Series,
    draw_bars,
    draw_paper_mark,
    label_groups,
    legend,
    name_paper,
    slot_offset,
)
from pa_console.evaluation.reporting.figure_style import (
    BLUE,
    GRID,
    HATCHES,
    INK,
    SERIES,
    SKY,
    new_figure,
)
from pa_console.evaluation.reporting.latency import STAGES, stage_name, stage_seconds
from pa_console.evaluation.reporting.published import MODELS, published
from pa_console.evaluation.reporting.record_groups import Records, by_model
from pa_console.evaluation.reporting.statistics import spread
from pa_console.evaluation.reporting.tables_latency import QUANTITIES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHOWN = {"decision": (SKY, ""), "end to end, station": (BLUE, "//")}
"""The latencies that are drawn; simulated execution would dwarf them."""

LEAST_SHARE = 0.01
"""Stages that take no more than this of the whole, for every model, are drawn as one."""

REST = "the rest, 1% or less each"


def figure_four(records: Records, beside: bool) -> "Figure":
    """Draw mean latencies by model; `beside` adds those that the paper's text gives."""
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
    found = spread([QUANTITIES[name](record) for record in records])
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
