"""Tables of success (the paper's Table I and Fig. 3), ablations, failures and latencies."""

import re
from collections.abc import Callable, Sequence
from statistics import fmean, median
from typing import Literal, NamedTuple

from pa_console.evaluation.jobs import REFERENCE
from pa_console.evaluation.reporting.statistics import (
    HYBRID_BY_CATEGORY,
    MISSION_SET,
    MODELS,
    NOTHING,
    Cell,
    Quantity,
    Records,
    ReportTable,
    SuccessRate,
    ablated_models,
    by_model,
    by_set,
    comparable_runs,
    grouped,
    main_runs,
    main_variant,
    model_groups,
    percent,
    published,
    rate_cell,
    seconds,
    spread,
    success_rate,
    table_of,
    table_of_rows,
)
from pa_console.evaluation.reporting.tables_judgement import refusal_recall
from pa_console.evaluation.run_record import RunRecord

_RULE = re.compile(r"^[A-Z]{2,5}-\d+")
_ROOT = re.compile(r"\brun\.((?:start|final)\.[a-z]+|[a-z_]+)")
_FIELD = re.compile(r"(?:\]|\b(?!run\b)[a-z]\w{0,2})\.([a-z_]+)\b(?!\()")
_NAME = re.compile(r"\b\w*(?:[a-z][A-Z]|_|\d)\w*\b")
_QUOTED = re.compile(r"'[^']*'|\"[^\"]*\"")
_CONSTANTS = frozenset(("gates", "base", "command", "grace_s", "standoff_m"))
"""The fields of `run` about the world or the command, which cannot be the cause of a failure."""

ABLATION_COLUMNS = (
    "Variant", "strict", "points", "better/ worse", "obeyed", "hybrid", "refusal recall",
    "broke a rule", "decision s", "tokens",
)  # fmt: skip
WAYS = 6
"""The number of kinds of failure in a table; all other kinds share one row."""
EXAMPLES = 2
"""The number of examples for a kind of failure."""

EXECUTED = frozenset(("verified", "unverified"))
"""The statuses of missions with a plan that was executed, at least in part."""

SCORES: dict[str, Callable[[Records], SuccessRate]] = {
    "hybrid": lambda runs: success_rate(runs, "hybrid"),
    "strict": lambda runs: success_rate(runs, "strict"),
    "strict if the judge is obeyed": lambda runs: success_rate(runs, "obeyed"),
}
"""The rates in tables of success, by the title of the column."""

DECISION_STAGES = (
    "retrieval_s", "picture_s", "prompt_s", "planning_s", "checks_s", "rehearsal_s", "judging_s",
)  # fmt: skip
"""The stages from the command to a judged plan, including repairs: fields of Metrics, wall time."""

STAGES = (*DECISION_STAGES, "readings_s", "dispatch_s", "outcome_s")
"""All stages that take wall time. Execution is not one of them, because it is simulated."""


class FailureKind(NamedTuple):
    """A kind of failure: the expected result of the mission, its final status, and the cause."""

    wanted: str
    ended: str
    cause: str


def failure_kind(record: RunRecord) -> FailureKind | None:
    """Return the kind of failure of `record`; None if it is a strict success.

    If a plan was executed, the cause is the broken rules and the kinds of conditions that do not
    hold. Otherwise, the cause is the reason why nothing was executed.
    """
    if record.strict:
        return None
    expected = {"refuse": "refuse", "trim": "carry out a part"}.get(record.expect, "carry out")
    causes = [f"broke {rule}" for rule in sorted({breach.rule_id for breach in record.broken})]
    if record.status in EXECUTED:
        causes += sorted({f"condition on {condition_kind(text)}" for text in record.failed})
    else:
        causes.append(reason_pattern(record.reason))
    return FailureKind(
        expected, record.status, "; ".join(filter(None, causes)) or "no cause is recorded"
    )


def condition_kind(condition: str) -> str:
    """Return the facts of the run that a success condition uses, without names and numbers.

    `run.tracks.exists(t, t.gate == 'X' && t.observed_s >= 0.0)` is `tracks (gate, observed_s)`.
    """
    bare = _QUOTED.sub("''", condition)
    roots = dict.fromkeys(name for name in _ROOT.findall(bare) if name not in _CONSTANTS)
    fields = dict.fromkeys(name for name in _FIELD.findall(bare))
    text = ", ".join(roots) or "no fact of the run"
    return f"{text} ({', '.join(fields)})" if fields else text


def reason_pattern(reason: str) -> str:
    """Return the kinds of a `reason` why nothing was executed.

    Each kind is a rule id, or the words of the reason without names and numbers.
    """
    kinds: dict[str, None] = {}
    for part in filter(None, (piece.strip() for piece in reason.split(";"))):
        rule = _RULE.match(part)
        words = _NAME.sub("…", _QUOTED.sub("…", part))
        kinds[rule.group() if rule else re.sub(r"…(\W+…)+", "…", words)[:60]] = None
    return "; ".join(sorted(kinds))


def paper_cell(model: str, quantity: Quantity) -> str:
    """Return the paper's rate `quantity` for its `model`, with a star if the value is derived."""
    value = published(model, quantity)
    return NOTHING if value is None else percent(value.value) + "*" * value.derived


def success_tables(records: Records) -> list[ReportTable]:
    """Return Table I and Fig. 3 for the paper's missions, and tables by set and by category."""
    paper = comparable_runs(records)
    tables: list[ReportTable] = []
    if paper:
        tables += [table_one(paper, "hybrid"), table_one(paper, "strict"), figure_three(paper)]
    main = main_runs(records)
    tables.append(_by_set(main))
    tables += [
        _by_category(runs, name) for name, runs in by_set(main).items() if name != MISSION_SET
    ]
    return tables


def table_one(records: Records, name: Literal["hybrid", "strict"]) -> ReportTable:
    """Return Table I for the kind of success `name`; for `hybrid`, add the columns of the paper."""
    models = by_model(records)
    paper_models = list(MODELS) if name == "hybrid" else []
    rows: list[tuple[str, ...]] = []
    for category, runs in grouped(records, lambda record: record.category).items():
        ours, paper = by_model(runs), HYBRID_BY_CATEGORY.get(category, {})
        rates = (success_rate(ours.get(model, []), name) for model in models)
        papers = (percent(paper.get(model)) for model in paper_models)
        rows.append((category, *map(rate_cell, rates), *papers))
    totals = (rate_cell(success_rate(runs, name)) for runs in models.values())
    rows.append(("All", *totals, *(paper_cell(model, "hybrid") for model in paper_models)))
    columns = ("Scenario", *models, *(f"paper: {model}" for model in paper_models))
    return table_of_rows(f"table-1-{name}", columns, rows)


def figure_three(records: Records) -> ReportTable:
    """Return overall success by model (Fig. 3), followed by the paper's models."""
    own = table_of("figure-3", ("Model",), SCORES, model_groups(records))
    paper_rows = [
        (f"paper: {full}", paper_cell(model, "hybrid"), paper_cell(model, "strict"), NOTHING)
        for model, full in MODELS.items()
    ]
    return own.model_copy(update={"rows": (*own.rows, *paper_rows)})


def _by_set(records: Records) -> ReportTable:
    groups = {
        (name, model): model_runs
        for name, runs in by_set(records).items()
        for model, model_runs in by_model(runs).items()
    }
    columns: dict[str, Callable[[Records], Cell]] = {
        "missions": lambda runs: len({run.mission for run in runs}),
        **SCORES,
    }
    return table_of("sets", ("Set", "Model"), columns, groups)


def _by_category(records: Records, name: str) -> ReportTable:
    categories = sorted(records, key=lambda record: record.category)
    groups = grouped(categories, lambda record: (record.category, record.model))
    return table_of("categories", ("Category", "Model"), SCORES, groups, of=name)


class Difference(NamedTuple):
    """The strict success of a variant compared with the reference, in runs of the same cases."""

    pairs: int
    better: int
    worse: int

    @property
    def points(self) -> float | None:
        """The difference in percentage points; None if there are no pairs."""
        return 100 * (self.better - self.worse) / self.pairs if self.pairs else None


def difference(records: Records, reference: Records) -> Difference:
    """Return the difference from `reference` over runs of the same mission and seed."""
    strict_of = {record.case: record.strict for record in reference}
    both = [
        (record.strict, strict_of[record.case]) for record in records if record.case in strict_of
    ]
    better = sum(mine and not reference_strict for mine, reference_strict in both)
    return Difference(
        len(both), better, sum(reference_strict and not mine for mine, reference_strict in both)
    )


def reference_variant(records: Records) -> str:
    """Return the variant with which the other variants of a model are compared."""
    return REFERENCE if any(r.variant == REFERENCE for r in records) else main_variant(records)


def ablation_tables(records: Records) -> list[ReportTable]:
    """Return a table for each model with runs in two or more variants."""
    models = by_model(records)
    return [
        _ablation(model, models[model], {n: runs for n, runs in models.items() if n != model})
        for model in ablated_models(records)
    ]


def variants_of(records: Records) -> dict[str, list[RunRecord]]:
    """Return the runs by variant, starting with the reference."""
    reference = reference_variant(records)
    variants = grouped(records, lambda record: record.variant)
    return {reference: variants[reference], **variants}


def _ablation(model: str, records: Records, others: dict[str, list[RunRecord]]) -> ReportTable:
    """Return the table of all variants of `model`, and of other models in its reference variant."""
    variants = variants_of(records)
    reference = next(iter(variants))
    shown = dict(variants)
    for name, runs in others.items():
        alike = [run for run in runs if run.variant == reference]
        if difference(alike, variants[reference]).pairs:
            shown[f"model {name}"] = alike
    rows = [_row(name, runs, variants[reference]) for name, runs in shown.items()]
    return table_of_rows("ablation", ABLATION_COLUMNS, rows, of=model, reference=reference)


def _row(name: str, runs: Records, reference: Records) -> tuple[str, ...]:
    change = difference(runs, reference)
    same = runs is reference
    return (
        name,
        rate_cell(success_rate(runs, "strict")),
        NOTHING if same or change.points is None else f"{change.points:+.0f}",
        NOTHING if same else f"{change.better}/{change.worse}",
        rate_cell(success_rate(runs, "obeyed")),
        rate_cell(success_rate(runs, "hybrid")),
        rate_cell(refusal_recall(runs)),
        rate_cell(SuccessRate.of(bool(run.broken) for run in runs)),
        decision_median(runs),
        _tokens(runs),
    )


def _tokens(records: Records) -> str:
    used = [run.planner for run in records if run.planner.prompt_tokens]
    if not used:
        return NOTHING
    prompt_tokens = median(usage.prompt_tokens for usage in used)
    return f"{prompt_tokens:.0f} / {median(usage.completion_tokens for usage in used):.0f}"


def failure_tables(records: Records) -> list[ReportTable]:
    """Return a table of the most common failures for each model, and the table of attempts."""
    main = main_runs(records)
    return [*(_failures(model, runs) for model, runs in by_model(main).items()), _attempts(main)]


def _failures(model: str, records: Records) -> ReportTable:
    failed = [record for record in records if not record.strict]
    groups = grouped(failed, failure_kind)
    ranked = sorted(groups.items(), key=lambda item: -len(item[1]))
    rows = [
        (*kind, rate_cell(SuccessRate(len(runs), len(failed))), _examples(runs))
        for kind, runs in ranked[:WAYS]
        if kind is not None
    ]
    rest = sum(len(runs) for _, runs in ranked[WAYS:])
    if rest:
        others = f"{len(ranked) - WAYS} other kinds"
        rows.append(("", "", others, rate_cell(SuccessRate(rest, len(failed))), ""))
    return table_of_rows(
        "failures",
        ("to do", "ended", "what went wrong", "of the failed runs", "examples"),
        rows,
        of=model,
        failed=len(failed),
        runs=len(records),
    )


def _examples(runs: Sequence[RunRecord]) -> str:
    """Return the ids of at most EXAMPLES runs, each of a different mission."""
    missions = grouped(runs, lambda record: record.mission)
    return ", ".join(examples[0].run for examples in list(missions.values())[:EXAMPLES])


def _attempts(records: Records) -> ReportTable:
    def mended(runs: Records) -> list[RunRecord]:
        return [run for run in runs if not run.first_sound and run.attempts > 1]

    columns: dict[str, Callable[[Records], Cell]] = {
        "readable": lambda runs: SuccessRate.of(run.valid_json for run in runs),
        "sound at first": lambda runs: SuccessRate.of(run.first_sound for run in runs),
        "sent back": lambda runs: SuccessRate(len(mended(runs)), len(runs)),
        "executed after repair": lambda runs: SuccessRate.of(
            run.status in EXECUTED for run in mended(runs)
        ),
        "strict after repair": lambda runs: SuccessRate.of(run.strict for run in mended(runs)),
        "attempts": lambda runs: f"{fmean(run.attempts for run in runs):.2f}",
    }
    return table_of("attempts", ("Model",), columns, model_groups(records))


def stage_name(stage: str) -> str:
    """Return the name of the Metrics field `stage` in tables and figures."""
    return stage.removesuffix("_s").replace("_", " ")


def stage_seconds(record: RunRecord, stage: str) -> float:
    """Return the seconds of one stage of a run; `stage` is a field of Metrics."""
    return float(getattr(record.metrics, stage))


def decision_seconds(record: RunRecord) -> float:
    """Return the wall time from the command to a judged plan, including repairs, in seconds."""
    return sum(stage_seconds(record, stage) for stage in DECISION_STAGES)


def field_seconds(record: RunRecord) -> float:
    """Return the sum of decision, dispatch and simulated execution, in seconds.

    This is the paper's end-to-end latency (Section V-D), from the command to the confirmation, for
    assets with the speed of the simulated ones.
    """
    return decision_seconds(record) + record.metrics.dispatch_s + record.metrics.execution_s


LATENCIES: dict[str, Callable[[RunRecord], float]] = {
    "first token": lambda record: record.metrics.first_token_s,
    "decision": decision_seconds,
    "end to end, station": lambda record: record.metrics.end_to_end_s,
    "end to end, field": field_seconds,
}
"""The latencies of a run by name, in the order of the table."""


def latency_tables(records: Records) -> list[ReportTable]:
    """Return the table of Fig. 4 and the table of all stages.

    Fig. 4 shows only the paper's missions if they have runs.
    """
    main, paper = main_runs(records), comparable_runs(records)
    return [_figure_four(paper or main, bool(paper)), _stages(main)]


def _figure_four(records: Records, comparable: bool) -> ReportTable:
    rows: list[tuple[str, ...]] = []
    for model, runs in by_model(records).items():
        for name, measure in LATENCIES.items():
            times = spread([measure(record) for record in runs])
            if times is not None:
                mean = f"{seconds(times.mean)} ± {seconds(times.margin)}"
                cells = (mean, seconds(times.median), seconds(times.p95))
                rows.append((model, name, *cells, str(times.n)))
    if rows and comparable:
        for model, full in MODELS.items():
            value = published(model, "latency_s")
            cell = NOTHING if value is None else seconds(value.value)
            rows.append((f"paper: {full}", "end to end", cell, NOTHING, NOTHING, NOTHING))
    return table_of_rows("figure-4", ("Model", "latency", "mean", "median", "p95", "runs"), rows)


def _stages(records: Records) -> ReportTable:
    models = by_model(records)
    rows = [
        (stage_name(stage), *(_stage_cell(runs, stage) for runs in models.values()))
        for stage in STAGES
    ]
    rows.append(
        ("execution (simulated)", *(_stage_cell(runs, "execution_s") for runs in models.values()))
    )
    rows.append(("runs", *(str(len(runs)) for runs in models.values())))
    return table_of_rows("stages", ("Stage", *models), rows if models else ())


def _stage_cell(records: Records, stage: str) -> str:
    taken = [stage_seconds(record, stage) for record in records]
    times = spread(taken)
    if times is None:
        return NOTHING
    cell = f"{seconds(times.median)} / {seconds(times.p95)}"
    whole = sum(stage_seconds(record, name) for record in records for name in STAGES)
    return f"{cell}, {100 * sum(taken) / whole:.1f}%" if stage in STAGES and whole else cell


def decision_median(records: Records) -> str:
    """Return the median decision latency of `records` as text."""
    times = spread([decision_seconds(record) for record in records])
    return NOTHING if times is None else seconds(times.median)
