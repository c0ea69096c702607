"""The most common ways of failing, and how often answers had to be mended."""

from collections.abc import Sequence
from statistics import fmean

from pa_console.evaluation.record import RunRecord
from pa_console.evaluation.reporting.failure_kinds import EXECUTED, failure_kind
from pa_console.evaluation.reporting.record_groups import Records, by_model, grouped, main_runs
from pa_console.evaluation.reporting.statistics import Rate
from pa_console.evaluation.reporting.table import Table, rate_cell

WAYS = 6
EXAMPLES = 2


def failure_tables(records: Records) -> list[Table]:
    """Return the ways in which each model fails most, and the attempts it takes."""
    main = main_runs(records)
    tables = [_failures(model, runs) for model, runs in by_model(main).items()]
    return [table for table in (*tables, _attempts(main)) if table.rows]


def _failures(model: str, records: Records) -> Table:
    failed = [record for record in records if not record.strict]
    groups = grouped(failed, failure_kind)
    ranked = sorted(groups.items(), key=lambda item: -len(item[1]))
    rows = [
        (*kind, rate_cell(Rate(len(runs), len(failed))), _examples(runs))
        for kind, runs in ranked[:WAYS]
        if kind is not None
    ]
    rest = sum(len(runs) for _, runs in ranked[WAYS:])
    if rest:
        others = f"{len(ranked) - WAYS} other ways"
        rows.append(("", "", others, rate_cell(Rate(rest, len(failed))), ""))
    return Table(
        name=f"failures-{model}",
        title=f"Most common ways of failing: {model}",
        columns=("to do", "ended", "what went wrong", "of the failed runs", "examples"),
        rows=tuple(rows),
        note=(
            f"{len(failed)} of {len(records)} runs are no strict success. What went wrong: the "
            "enforced rules that the true state shows to be broken and the facts on which success "
            "conditions do not hold; for a mission that executed nothing, why it did not."
        ),
    )


def _examples(runs: Sequence[RunRecord]) -> str:
    """Return ids of runs, of different missions as far as there are some."""
    missions = grouped(runs, lambda record: record.mission)
    return ", ".join(found[0].run for found in list(missions.values())[:EXAMPLES])


def _attempts(records: Records) -> Table:
    rows: list[tuple[str, ...]] = []
    for model, runs in by_model(records).items():
        mended = [run for run in runs if not run.first_sound and run.attempts > 1]
        rows.append(
            (
                model,
                rate_cell(Rate.of(run.valid_json for run in runs)),
                rate_cell(Rate.of(run.first_sound for run in runs)),
                rate_cell(Rate(len(mended), len(runs))),
                rate_cell(Rate.of(run.status in EXECUTED for run in mended)),
                rate_cell(Rate.of(run.strict for run in mended)),
                f"{fmean(run.attempts for run in runs):.2f}",
            )
        )
    return Table(
        name="attempts",
        title="Attempts and repair",
        columns=(
            "Model", "readable", "sound at first", "sent back", "executed after repair",
            "strict after repair", "attempts",
        ),
        rows=tuple(rows),
        note=(
            "readable: the first answer could be read as a plan. sound at first: it broke no "
            "Critical or High rule. sent back: it did, and was asked for again. The next two are "
            "shares of those sent back; a command that must be refused is rightly never executed. "
            "attempts: mean a run."
        ),
    )  # fmt: skip
