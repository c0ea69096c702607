"""All tables of an evaluation, in the order in which a report shows them."""

from collections.abc import Sequence

from pa_console.evaluation.reporting.calibration import calibration_tables, confidence_tables
from pa_console.evaluation.reporting.table import Table
from pa_console.evaluation.reporting.tables_judgement import judge_tables, reading_tables
from pa_console.evaluation.reporting.tables_latency import latency_tables
from pa_console.evaluation.reporting.tables_outcomes import (
    ablation_tables,
    failure_tables,
    success_tables,
)
from pa_console.evaluation.runs.run_record import RunRecord

__all__ = ["Table", "build_sections", "build_tables"]

SUCCESS, LATENCY, JUDGE, ABLATION, FAILURES = (
    "Success", "Latency", "Judgements and refusals", "Ablation", "Failures and repair",
)  # fmt: skip
"""The sections of a report that hold tables."""


def build_sections(records: Sequence[RunRecord]) -> dict[str, list[Table]]:
    """Return the tables of each section of a report, sections without any left out."""
    sections = {
        SUCCESS: success_tables(records),
        LATENCY: latency_tables(records),
        JUDGE: [
            *judge_tables(records),
            *confidence_tables(records),
            *calibration_tables(records),
            *reading_tables(records),
        ],
        ABLATION: ablation_tables(records),
        FAILURES: failure_tables(records),
    }
    return {title: tables for title, tables in sections.items() if tables}


def build_tables(records: Sequence[RunRecord]) -> list[Table]:
    """Return the tables that `records` give; none for no records.

    Tables by model speak of the main variant (record_groups.main_variant), ablations of all.
    """
    return [table for tables in build_sections(records).values() for table in tables]
