"""What each part of the pipeline buys and what it costs: the variants compared."""

from statistics import median
from typing import NamedTuple

from pa_console.evaluation.record import RunRecord
from pa_console.evaluation.reporting.record_groups import (
    Records,
    ablated_models,
    by_model,
    grouped,
    main_variant,
)
from pa_console.evaluation.reporting.statistics import Rate
from pa_console.evaluation.reporting.table import NOTHING, Table, rate_cell
from pa_console.evaluation.reporting.tables_judge import refusal_recall
from pa_console.evaluation.reporting.tables_latency import decision_median
from pa_console.evaluation.reporting.tables_success import score
from pa_console.evaluation.variants import REFERENCE


class Difference(NamedTuple):
    """Strict success of a variant against the reference, on the runs that both made."""

    pairs: int
    better: int
    worse: int

    @property
    def points(self) -> float | None:
        """The difference in percentage points; None without a pair."""
        return 100 * (self.better - self.worse) / self.pairs if self.pairs else None


def difference(records: Records, reference: Records) -> Difference:
    """Compare the runs of the same mission and seed."""
    known = {_pair(record): record.strict for record in reference}
    both = [(record.strict, known[_pair(record)]) for record in records if _pair(record) in known]
    better = sum(mine and not theirs for mine, theirs in both)
    return Difference(len(both), better, sum(theirs and not mine for mine, theirs in both))


def _pair(record: RunRecord) -> tuple[str, str, int]:
    return record.mission_set, record.mission, record.seed


def reference_variant(records: Records) -> str:
    """Return the variant that the others of one model are compared with."""
    return REFERENCE if any(r.variant == REFERENCE for r in records) else main_variant(records)


def ablation_tables(records: Records) -> list[Table]:
    """Return one table for each model that ran under two variants or more."""
    models = by_model(records)
    return [
        _ablation(model, models[model], {n: runs for n, runs in models.items() if n != model})
        for model in ablated_models(records)
    ]


def variants_of(records: Records) -> dict[str, list[RunRecord]]:
    """Return the runs by variant, the reference first."""
    reference = reference_variant(records)
    found = grouped(records, lambda record: record.variant)
    return {reference: found[reference], **found}


def _ablation(model: str, records: Records, others: dict[str, list[RunRecord]]) -> Table:
    """Return the rows of every variant of `model`, then of other models under its reference."""
    variants = variants_of(records)
    reference = next(iter(variants))
    shown = dict(variants)
    for name, runs in others.items():
        alike = [run for run in runs if run.variant == reference]
        if difference(alike, variants[reference]).pairs:
            shown[f"model {name}"] = alike
    rows = [_row(name, runs, variants[reference]) for name, runs in shown.items()]
    return Table(
        name=f"ablation-{model}",
        title=f"Ablation: what each part buys and costs ({model})",
        columns=(
            "Variant", "strict", "points", "better/ worse", "obeyed", "hybrid", "refusal recall",
            "broke a rule", "decision s", "tokens",
        ),
        rows=tuple(rows),
        note=(
            f"All mission sets. points: strict success against '{reference}' in percentage points, "
            "on the runs with the same mission and seed; better/worse: how many of them changed. "
            "model ...: another model under that variant. "
            "obeyed: strict success if a judge's Failure before execution were obeyed. broke a "
            "rule: runs whose true state breaks an enforced rule. decision s: median. tokens: "
            "median of the first answer's prompt / answer."
        ),
    )  # fmt: skip


def _row(name: str, runs: Records, reference: Records) -> tuple[str, ...]:
    found = difference(runs, reference)
    same = runs is reference
    return (
        name,
        rate_cell(score(runs, "strict")),
        NOTHING if same or found.points is None else f"{found.points:+.0f}",
        NOTHING if same else f"{found.better}/{found.worse}",
        rate_cell(score(runs, "obeyed")),
        rate_cell(score(runs, "hybrid")),
        rate_cell(refusal_recall(runs)),
        rate_cell(Rate.of(bool(run.broken) for run in runs)),
        decision_median(runs),
        _tokens(runs),
    )


def _tokens(records: Records) -> str:
    used = [run.planner for run in records if run.planner.prompt_tokens]
    if not used:
        return NOTHING
    asked = median(usage.prompt_tokens for usage in used)
    return f"{asked:.0f} / {median(usage.completion_tokens for usage in used):.0f}"
