"""The figures of a report: the paper's Figs. 3 to 5 and Table I, the ablation and the stages."""

from functools import partial

from pa_console.evaluation.reporting.figure_style import Drawn
from pa_console.evaluation.reporting.figures_latency import figure_four, stages
from pa_console.evaluation.reporting.figures_success import (
    ablation,
    figure_five,
    figure_three,
    table_one,
)
from pa_console.evaluation.reporting.record_groups import (
    Records,
    ablated_models,
    comparable_runs,
    main_runs,
)
from pa_console.evaluation.reporting.tables import ABLATION, JUDGE, LATENCY, SUCCESS


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
