"""The figures of a report: the paper's Figs. 3 to 5 and Table I, the ablation and the stages."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from pa_console.evaluation.reporting.drawing import (
    BLUE,
    GREEN,
    GRID,
    INK,
    ORANGE,
    SKY,
    Style,
    draw_bars,
    draw_dots,
    draw_paper_letter,
    draw_paper_mark,
    label_groups,
    legend,
    name_paper,
    new_figure,
    percent_axis,
    percent_interval,
    percents,
    series_style,
    slot_offset,
)
from pa_console.evaluation.reporting.statistics import (
    HYBRID_BY_CATEGORY,
    MODELS,
    TEXTS,
    Interval,
    Quantity,
    Records,
    SuccessKind,
    ablated_models,
    by_model,
    comparable_runs,
    grouped,
    main_runs,
    published,
    spread,
    success_rate,
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
    stage_name,
    stage_seconds,
    variants_of,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SUCCESS, LATENCY, JUDGE, ABLATION, FAILURES = (
    "Success", "Latency", "Judgements and refusals", "Ablation", "Failures and repair",
)  # fmt: skip
"""The sections of a report, in order."""

SCORES: dict[SuccessKind, Style] = {
    "hybrid": Style("hybrid", SKY),
    "strict": Style("strict", BLUE),
    "obeyed": Style("strict if the judge is obeyed", ORANGE, "//"),
}
QUANTITIES: dict[Quantity, Style] = {
    "precision": Style("precision", BLUE),
    "recall": Style("recall", ORANGE, "//"),
    "f1": Style("F1", GREEN, ".."),
}
SHOWN = {
    "decision": Style("decision", SKY),
    "end to end, station": Style("end to end, station", BLUE, "//"),
}
"""The latencies in the figure. It leaves out the simulated execution, which is much longer."""

LEAST_SHARE = 0.01
"""The largest share of the total time that a stage may have to be merged with other small stages.

It applies only if the stage's share is that small for every model.
"""

REST = "the rest, 1% or less each"


Name = TypeVar("Name", bound=str)
PaperMark = tuple[float, str]
"""A value of the paper on the axis, and the text beside the mark."""


class Drawn(NamedTuple):
    """A figure of a report; `name` is the name of its file, and `alt` is its description."""

    section: str
    name: str
    title: str
    alt: str
    draw: Callable[[], "Figure"]


def draw_models(  # noqa: PLR0917 - our models with bars, and the paper's models with marks
    ax: "Axes",
    models: Mapping[str, Records],
    styles: Mapping[Name, Style],
    value: Callable[[Records, Name], Interval | None],
    paper_models: Sequence[str],
    mark: Callable[[str, Name], PaperMark | None],
) -> None:
    """Draw a group of bars for each of `models`, then rings for `paper_models`."""
    bars = {
        style: [value(runs, name) for runs in models.values()] for name, style in styles.items()
    }
    draw_bars(ax, bars)
    for number, model in enumerate(paper_models):
        for slot, (name, style) in enumerate(styles.items()):
            marked = mark(model, name)
            if marked is not None:
                at = len(models) + number + slot_offset(slot, len(styles))
                draw_paper_mark(ax, at, marked[0], style.colour, marked[1])
    label_groups(ax, [*models, *(MODELS[m] for m in paper_models)], len(models))


def _rate_mark(model: str, quantity: str) -> PaperMark | None:
    """Return a rate of the paper in percent, with a star if the value is derived."""
    value = published(model, quantity)
    return None if value is None else (100 * value.value, "*" * value.derived)


def figure_three(records: Records, beside: bool) -> "Figure":
    """Draw overall success by model; if `beside`, add the paper's models on the right."""
    paper_models = list(MODELS) if beside else []
    figure, (ax,) = new_figure(7.2, 3.6)
    draw_models(
        ax,
        by_model(records),
        SCORES,
        lambda runs, name: percent_interval(success_rate(runs, name)),
        paper_models,
        _rate_mark,
    )
    percent_axis(ax, "successful runs, %")
    if paper_models:
        name_paper(ax, "paper (* follows from its Table I)")
    legend(figure, ax, 4)
    return figure


def figure_four(records: Records, beside: bool) -> "Figure":
    """Draw mean latencies by model; if `beside`, add the latencies in the paper's text."""
    paper_models = [m for m in MODELS if beside and published(m, "latency_s") is not None]

    def mark(model: str, name: str) -> PaperMark | None:
        value = published(model, "latency_s") if name == "end to end, station" else None
        return None if value is None else (value.value, f"{value.value:.2f} s")

    figure, (ax,) = new_figure(7.2, 3.4)
    draw_models(ax, by_model(records), SHOWN, _mean, paper_models, mark)
    ax.set_ylim(bottom=0)
    ax.set_ylabel("mean seconds per run")
    if paper_models:
        name_paper(ax, "paper, end to end")
    legend(figure, ax, 3)
    return figure


def _mean(records: Records, name: str) -> Interval | None:
    latency = spread([LATENCIES[name](record) for record in records])
    if latency is None:
        return None
    return latency.mean, max(latency.mean - latency.margin, 0.0), latency.mean + latency.margin


def figure_five(records: Records, beside: bool) -> "Figure":
    """Draw precision, recall and F1 of the judge before and after execution."""
    models = by_model(records)
    figure, axes = new_figure(7.2, 5.4, rows=2)
    judgements: tuple[tuple[VerdictSource, str], ...] = (
        ("judge, plan", "before execution: verdict on the plan"),
        ("judge, outcome", "after execution: verdict on the outcome"),
    )
    for ax, (judgement, title) in zip(axes, judgements, strict=True):

        def value(
            runs: Records, name: Quantity, judgement: VerdictSource = judgement
        ) -> Interval | None:
            counts = confusion(runs, judgement)
            if name == "f1":
                return None if counts.f1 is None else percents(counts.f1)
            return percent_interval(counts.precision if name == "precision" else counts.recall)

        after = judgement == "judge, outcome"
        paper_models = [
            m for m in MODELS if beside and after and any(published(m, q) for q in QUANTITIES)
        ]
        draw_models(ax, models, QUANTITIES, value, paper_models, _rate_mark)
        percent_axis(ax, "%")
        ax.set_title(title, loc="left", fontsize=9)
        if paper_models:
            name_paper(ax, "paper (* follows from the other two)")
        if after:
            legend(figure, ax, 4)
    return figure


def table_one(records: Records, beside: bool) -> "Figure":
    """Draw hybrid and strict success by category, with the paper's values as letters in rings."""
    models = by_model(records)
    categories = grouped(records, lambda record: record.category)
    paper_models = list(MODELS) if beside else []
    figure, axes = new_figure(7.2, 5.4, rows=2)
    kinds: tuple[SuccessKind, ...] = ("hybrid", "strict")
    for ax, name in zip(axes, kinds, strict=True):
        bars = {
            series_style(number, model): [
                percent_interval(success_rate([run for run in runs if run.model == model], name))
                for runs in categories.values()
            ]
            for number, model in enumerate(models)
        }
        beside_ours = paper_models if name == "hybrid" else []
        slots = len(models) + len(beside_ours)
        draw_bars(ax, bars, slots)
        label_groups(ax, list(categories), len(categories))
        percent_axis(ax, f"{name} success, %")
        for x, category in enumerate(categories):
            values = HYBRID_BY_CATEGORY.get(category, {})
            for number, model in enumerate(beside_ours, start=len(models)):
                if model in values:
                    at = x + slot_offset(number, slots)
                    draw_paper_letter(ax, at, 100 * values[model], model[0])
        if beside_ours:
            name_paper(ax, f"paper: {', '.join(f'{model[0]} {model}' for model in paper_models)}")
        if name == "hybrid":
            legend(figure, ax, 3)
    return figure


def stages(records: Records) -> "Figure":
    """Draw the mean seconds of all stages as one stacked bar for each model."""
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
        columns = zip(*(means[stage] for stage in rest), strict=True)
        parts[REST] = [sum(column, 0.0) for column in columns]
    figure, (ax,) = new_figure(7.2, 1.3 + 0.45 * len(models))
    places = range(len(models))
    left: list[float] = [0.0] * len(models)
    for number, (name, values) in enumerate(parts.items()):
        style = Style(REST, GRID) if name == REST else series_style(number, name)
        ax.barh(
            places, values, 0.62, left,
            color=style.colour, hatch=style.hatch, edgecolor=INK, linewidth=0.5, label=name,
        )  # fmt: skip
        left = [start + value for start, value in zip(left, values, strict=True)]
    ax.set_yticks(list(places), list(models))
    ax.tick_params(axis="y", length=0)
    ax.invert_yaxis()
    ax.set_xlabel("mean seconds per run, without simulated execution")
    ax.grid(visible=False, axis="y")
    ax.grid(axis="x")
    legend(figure, ax, 5)
    return figure


def ablation(records: Records) -> "Figure":
    """Draw a model's success in each variant as dots with intervals, the reference on top."""
    variants = variants_of(records)
    figure, (ax,) = new_figure(7.2, 1.1 + 0.42 * len(variants))
    for number, (name, style) in enumerate(SCORES.items()):
        points = [
            (place + (number - 1) * 0.22, *interval)
            for place, runs in enumerate(variants.values())
            if (interval := percent_interval(success_rate(runs, name))) is not None
        ]
        draw_dots(
            ax, points, style.label, style.colour,
            upright=False, fmt="so^"[number], ms=5.5, elinewidth=1.4,
        )  # fmt: skip
    reference = success_rate(next(iter(variants.values())), "strict").value or 0.0
    ax.axvline(100 * reference, color=BLUE, linewidth=0.8, linestyle="--", zorder=0)
    ax.set_yticks(range(len(variants)), list(variants))
    ax.set_ylim(len(variants) - 0.5, -0.5)
    ax.set_xlim(-2, 102)
    ax.set_xlabel("successful runs, % (dashed: strict success of the reference)")
    ax.grid(axis="x")
    legend(figure, ax, 3)
    return figure


def reliability_diagram(records: Records) -> "Figure":
    """Draw a line of strict success by confidence, with 95 % intervals, for each model."""
    figure, (ax,) = new_figure(4.6, 4.0)
    ax.plot([0, 100], [0, 100], color=INK, linewidth=0.8, linestyle="--", label="as sure as right")
    shapes = "os^Dv"
    for number, (model, runs) in enumerate(by_model(main_runs(records)).items()):
        points = [
            (100 * group.confidence, *interval)
            for group in reliability(confidence_and_success(runs))
            if (interval := percent_interval(group.strict)) is not None
        ]
        draw_dots(
            ax, points, model, series_style(number, model).colour, upright=True,
            fmt=f"{shapes[number % len(shapes)]}-", ms=5.0, linewidth=1.0, elinewidth=1.0,
        )  # fmt: skip
    ax.set_xlim(-4, 104)
    ax.set_xlabel("confidence, %")
    percent_axis(ax, "strict success, %")
    ax.grid(axis="x", color=GRID)
    legend(figure, ax, 3)
    return figure


def build_figures(records: Records) -> list[Drawn]:
    """Return the figures for `records`, still to be drawn; an empty list if there are no records.

    Figs. 3 to 5 and Table I show the runs of the paper's missions, or all runs if there are none.
    """
    main, paper = main_runs(records), comparable_runs(records)
    if not main:
        return []
    shown, beside = paper or main, bool(paper)
    figures = [
        _drawn(SUCCESS, "figure-3", partial(figure_three, shown, beside)),
        _drawn(SUCCESS, "table-1", partial(table_one, shown, beside)),
        _drawn(LATENCY, "figure-4", partial(figure_four, shown, beside)),
        _drawn(LATENCY, "stages", partial(stages, main)),
        _drawn(JUDGE, "figure-5", partial(figure_five, shown, beside)),
    ]
    if confidence_and_success(main):
        figures.append(_drawn(JUDGE, "reliability", partial(reliability_diagram, main)))
    for number, model in enumerate(ablated_models(records), start=1):
        runs = [record for record in records if record.model == model]
        figure = _drawn(ABLATION, "ablation", partial(ablation, runs), of=model)
        figures.append(figure._replace(name=f"ablation-{number}"))
    return figures


def _drawn(section: str, name: str, draw: Callable[[], "Figure"], **values: str) -> Drawn:
    text = TEXTS.figures[name]
    return Drawn(section, name, text.title.format(**values), text.alt, draw)
