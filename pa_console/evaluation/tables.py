"""All tables of an evaluation, in the order in which a report shows them."""

from collections.abc import Sequence

from pa_console.evaluation.record import RunRecord
from pa_console.evaluation.table import Table
from pa_console.evaluation.tables_ablation import ablation_tables
from pa_console.evaluation.tables_failures import failure_tables
from pa_console.evaluation.tables_judge import judge_tables
from pa_console.evaluation.tables_latency import latency_tables
from pa_console.evaluation.tables_success import success_tables

__all__ = ["Table", "build_tables"]


def build_tables(records: Sequence[RunRecord]) -> list[Table]:
    """Return the tables that `records` give; none for no records.

    Tables by model speak of the main variant (record_groups.main_variant), ablations of all.
    """
    return [
        *success_tables(records),
        *latency_tables(records),
        *judge_tables(records),
        *ablation_tables(records),
        *failure_tables(records),
    ]
