"""Which seconds of a run count to which latency."""

from pa_console.evaluation.record import RunRecord

DECISION_STAGES = (
    "retrieval_s", "picture_s", "prompt_s", "planning_s", "checks_s", "rehearsal_s", "judging_s",
)  # fmt: skip
"""From the command to a judged plan, repairs included; wall time (names of Metrics)."""

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
    """Return decision, dispatch, execution in simulated seconds and outcome together.

    That is the paper's end-to-end latency (Section V-D), from the command to the confirmation,
    for assets that move as fast as those simulated do.
    """
    metrics = record.metrics
    rest = metrics.dispatch_s + metrics.execution_s + metrics.outcome_s
    return decision_seconds(record) + rest
