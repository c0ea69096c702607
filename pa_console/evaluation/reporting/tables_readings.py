"""What an operator can put right who is offered other readings of an unclear command."""

from typing import NamedTuple

from pa_console.evaluation.record import RunRecord
from pa_console.evaluation.reporting.record_groups import Records, by_model, grouped, main_runs
from pa_console.evaluation.reporting.statistics import Rate
from pa_console.evaluation.reporting.table import Table, rate_cell
from pa_console.evaluation.variants import VARIANTS

CHOOSING = frozenset(name for name, variant in VARIANTS.items() if variant.reading)
"""The variants in which the operator chooses one of the readings that are offered."""


class _Mission(NamedTuple):
    mission_set: str
    mission: str
    seed: int


def reading_tables(records: Records) -> list[Table]:
    """Return success before and after a choice among readings; no table where none was made."""
    rows: list[tuple[str, ...]] = []
    chosen = by_model([record for record in records if record.variant in CHOOSING])
    for model, runs in by_model(main_runs(records)).items():
        if model in chosen:
            rows.append(_row(model, runs, chosen[model]))
    table = Table(
        name="readings",
        title="Success where another reading of the command may be chosen",
        columns=(
            "Model", "offered", "strict as read first", "strict as read or as one offered",
            "strict of all, the right one chosen",
        ),
        rows=tuple(rows),
        note=(
            "Where planner and judge are unsure of what was asked, the operator is offered what "
            "else it may mean. Every reading that was offered was chosen once and carried out: a "
            "mission counts where one of them is right, which is known to an operator who knows "
            "what was meant. It is no success of the models alone."
        ),
    )  # fmt: skip
    return [table] if rows else []


def _row(model: str, runs: Records, chosen: Records) -> tuple[str, ...]:
    others = grouped(chosen, _mission)
    offered = [run for run in runs if run.offered and _mission(run) in others]

    def right(run: RunRecord) -> bool:
        again = others[_mission(run)] if run.offered and _mission(run) in others else ()
        return run.strict or any(other.strict for other in again)

    rates = (
        Rate(len(offered), len(runs)),
        Rate.of(run.strict for run in offered),
        Rate.of(map(right, offered)),
        Rate.of(map(right, runs)),
    )
    return model, *map(rate_cell, rates)


def _mission(run: RunRecord) -> _Mission:
    return _Mission(run.mission_set, run.mission, run.seed)
