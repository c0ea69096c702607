"""The figures of a report: the paper's Figs. 3 to 5 and Table I, the ablation and the stages."""

from functools import partial
from typing import TYPE_CHECKING, Literal

from pa_console.evaluation.reporting.calibration import confidence_and_success, reliability_diagram
from pa_console.evaluation.reporting.figure_drawing import (
    BLUE,
    GREEN,
    GRID,
    HATCHES,
    INK,
    ORANGE,
    SERIES,
    SKY,
    Drawn,
    Interval,
    Series,
    draw_bars,
    draw_paper_letter,
    draw_paper_mark,
    label_groups,
    legend,
    name_paper,
    new_figure,
    percent_axis,
    percent_interval,
    slot_offset,
)
from pa_console.evaluation.reporting.published import (
    HYBRID_BY_CATEGORY,
    MODELS,
    Quantity,
    published,
)
from pa_console.evaluation.reporting.record_groups import (
    Records,
    ablated_models,
    by_model,
    comparable_runs,
    grouped,
    main_runs,
)
from pa_console.evaluation.reporting.statistics import spread
from pa_console.evaluation.reporting.tables import ABLATION, JUDGE, LATENCY, SUCCESS
from pa_console.evaluation.reporting.tables_judgement import Judgement, confusion
from pa_console.evaluation.reporting.tables_latency import QUANTITIES as TABLES_LATENCY_QUANTITIES
from pa_console.evaluation.reporting.tables_latency import STAGES, stage_name, stage_seconds
from pa_console.evaluation.reporting.tables_outcomes import SuccessKind, success_rate, variants_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
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
    found = spread([TABLES_LATENCY_QUANTITIES[name](record) for record in records])
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
    quantities: tuple[Literal["hybrid", "strict"], ...] = ("hybrid", "strict")
    for place, quantity in enumerate(quantities):
        for number, model in enumerate(theirs):
            value = published(model, quantity)
            if value is not None:
                at = len(models) + number + slot_offset(place, len(SCORES))
                star = "*" * value.derived
                draw_paper_mark(ax, at, 100 * value.value, SCORES[quantity][0], star)
    label_groups(ax, [*models, *(MODELS[m] for m in theirs)], len(models))
    percent_axis(ax, "successful runs, %")
    if theirs:
        name_paper(ax, "paper (* follows from its Table I)")
    legend(figure, ax, 4)
    return figure


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
    judgements: tuple[Judgement, ...] = ("judge, plan", "judge, outcome")
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
        _mark_judges(ax, shown, len(models))
        label_groups(ax, [*models, *(MODELS[m] for m in shown)], len(models))
        percent_axis(ax, "%")
        ax.set_title(title, loc="left", fontsize=9)
        if shown:
            name_paper(ax, "paper (* follows from the other two)")
        if judgement == "judge, outcome":
            legend(figure, ax, 4)
    return figure


def _mark_judges(ax: "Axes", theirs: list[str], ours: int) -> None:
    for number, model in enumerate(theirs):
        for place, (name, (colour, _)) in enumerate(QUANTITIES.items()):
            value = published(model, name)
            if value is not None:
                at = ours + number + slot_offset(place, len(QUANTITIES))
                draw_paper_mark(ax, at, 100 * value.value, colour, "*" * value.derived)


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
