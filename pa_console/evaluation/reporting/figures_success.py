"""Figures of success: Table I, Fig. 3 and Fig. 5 with the paper's values, and the ablation."""

from typing import TYPE_CHECKING, Literal

from pa_console.evaluation.reporting.figure_bars import (
    Series,
    draw_bars,
    draw_paper_letter,
    draw_paper_mark,
    label_groups,
    legend,
    name_paper,
    percent_axis,
    percent_interval,
    slot_offset,
)
from pa_console.evaluation.reporting.figure_style import (
    BLUE,
    GREEN,
    HATCHES,
    INK,
    ORANGE,
    SERIES,
    SKY,
    new_figure,
)
from pa_console.evaluation.reporting.published import (
    HYBRID_BY_CATEGORY,
    MODELS,
    Quantity,
    published,
)
from pa_console.evaluation.reporting.record_groups import Records, by_model, grouped
from pa_console.evaluation.reporting.tables_ablation import variants_of
from pa_console.evaluation.reporting.tables_judge import Judgement, confusion
from pa_console.evaluation.reporting.tables_success import Score, score

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SCORES: dict[Score, tuple[str, str, str]] = {
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
                [percent_interval(score(runs, name)) for runs in models.values()],
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
                    percent_interval(score([run for run in runs if run.model == model], name))
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
        rates = [score(runs, name) for runs in variants.values()]
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
    reference = score(next(iter(variants.values())), "strict").value or 0.0
    ax.axvline(100 * reference, color=BLUE, linewidth=0.8, linestyle="--", zorder=0)
    ax.set_yticks(list(places), list(variants))
    ax.set_ylim(len(variants) - 0.5, -0.5)
    ax.set_xlim(-2, 102)
    ax.set_xlabel("successful runs, % (dashed: strict success of the reference)")
    ax.grid(axis="x")
    legend(figure, ax, 3)
    return figure
