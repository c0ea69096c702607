"""Latency by model (the paper's Fig. 4) and where the time goes, stage by stage."""

from collections.abc import Callable

from pa_console.evaluation.reporting.published import MODELS, published
from pa_console.evaluation.reporting.record_groups import (
    Records,
    by_model,
    comparable_runs,
    main_runs,
)
from pa_console.evaluation.reporting.statistics import spread
from pa_console.evaluation.reporting.table import NOTHING, Table, seconds
from pa_console.evaluation.runs.run_record import RunRecord

DECISION_STAGES = (
    "retrieval_s", "picture_s", "prompt_s", "planning_s", "checks_s", "rehearsal_s", "judging_s",
)  # fmt: skip
"""The stages from the command to a judged plan, repairs included; wall time (names of Metrics)."""

STAGES = (*DECISION_STAGES, "readings_s", "dispatch_s", "outcome_s")
"""Every stage that takes wall time of the station; execution is simulated and stands apart."""


def stage_name(stage: str) -> str:
    """Return what tables and figures call the Metrics field `stage`."""
    return stage.removesuffix("_s").replace("_", " ")


def stage_seconds(record: RunRecord, stage: str) -> float:
    """Return the seconds of one stage of a run; `stage` is a field of Metrics."""
    return float(getattr(record.metrics, stage))


def decision_seconds(record: RunRecord) -> float:
    """Return the wall seconds from the command to a judged plan, repairs included."""
    return sum(stage_seconds(record, stage) for stage in DECISION_STAGES)


def field_seconds(record: RunRecord) -> float:
    """Return decision, dispatch and execution in simulated seconds together.

    That is the paper's end-to-end latency (Section V-D), from the command to the confirmation,
    for assets that move as fast as those simulated do.
    """
    return decision_seconds(record) + record.metrics.dispatch_s + record.metrics.execution_s


QUANTITIES: dict[str, Callable[[RunRecord], float]] = {
    "first token": lambda record: record.metrics.first_token_s,
    "decision": decision_seconds,
    "end to end, station": lambda record: record.metrics.end_to_end_s,
    "end to end, field": field_seconds,
}
"""The latencies of a run by name, in the order of the table."""

_NOTE = (
    "Seconds. First token: from the prompt to the first token of the first answer. Decision: from "
    "the command to a judged plan, repairs included. End to end, station: wall time from the "
    "command to the mission's end by telemetry; execution is simulated faster than real time. End "
    "to end, field: decision and dispatch in wall time plus execution in simulated seconds, which "
    "is what the paper's definition (Section V-D) comes to here. The verdict on the outcome is no "
    "part of either: it comes after the mission. The paper's assets move in another simulation, "
    "its models run on another machine."
)


def latency_tables(records: Records) -> list[Table]:
    """Return Fig. 4 (on the paper's missions when they were run) and the stages' latencies."""
    main, paper = main_runs(records), comparable_runs(records)
    tables = [_figure_four(paper or main, bool(paper)), _stages(main)]
    return [table for table in tables if table.rows]


def _figure_four(records: Records, comparable: bool) -> Table:
    rows: list[tuple[str, ...]] = []
    for model, runs in by_model(records).items():
        for name, measure in QUANTITIES.items():
            found = spread([measure(record) for record in runs])
            if found is not None:
                mean = f"{seconds(found.mean)} ± {seconds(found.margin)}"
                cells = (mean, seconds(found.median), seconds(found.p95))
                rows.append((model, name, *cells, str(found.n)))
    if rows and comparable:
        for model, full in MODELS.items():
            value = published(model, "latency_s")
            cell = NOTHING if value is None else seconds(value.value)
            rows.append((f"paper: {full}", "end to end", cell, NOTHING, NOTHING, NOTHING))
    return Table(
        name="figure-4",
        title="Fig. 4: latency by model",
        columns=("Model", "latency", "mean", "median", "p95", "runs"),
        rows=tuple(rows),
        note=f"{_NOTE} Mean ± half of its 95 % interval.",
    )


def _stages(records: Records) -> Table:
    models = by_model(records)
    rows = [
        (stage_name(stage), *(_stage_cell(runs, stage) for runs in models.values()))
        for stage in STAGES
    ]
    rows.append(
        ("execution (simulated)", *(_stage_cell(runs, "execution_s") for runs in models.values()))
    )
    rows.append(("runs", *(str(len(runs)) for runs in models.values())))
    return Table(
        name="stages",
        title="Latency by stage and model: median / 95th percentile, share of the whole",
        columns=("Stage", *models),
        rows=tuple(rows) if models else (),
        note=(
            "Seconds a run, all attempts of a stage together. The whole is the sum of all stages "
            "in wall time; simulated execution is not part of it."
        ),
    )


def _stage_cell(records: Records, stage: str) -> str:
    taken = [stage_seconds(record, stage) for record in records]
    found = spread(taken)
    if found is None:
        return NOTHING
    cell = f"{seconds(found.median)} / {seconds(found.p95)}"
    whole = sum(stage_seconds(record, name) for record in records for name in STAGES)
    return f"{cell}, {100 * sum(taken) / whole:.1f}%" if stage in STAGES and whole else cell


def decision_median(records: Records) -> str:
    """Write the median decision latency of `records`."""
    found = spread([decision_seconds(record) for record in records])
    return NOTHING if found is None else seconds(found.median)
