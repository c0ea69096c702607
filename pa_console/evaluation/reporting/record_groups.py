"""Groups of runs: by model, by variant, by set; and the definition of a refusal."""

from collections import Counter
from collections.abc import Callable, Sequence
from typing import TypeVar

from pa_console.evaluation.reporting.published import MISSION_SET
from pa_console.evaluation.runs.jobs import REFERENCE
from pa_console.evaluation.runs.run_record import RunRecord

Records = Sequence[RunRecord]
Key = TypeVar("Key")


def grouped(records: Records, key: Callable[[RunRecord], Key]) -> dict[Key, list[RunRecord]]:
    """Return the records of each key, keys in the order in which they first appear."""
    groups: dict[Key, list[RunRecord]] = {}
    for record in records:
        groups.setdefault(key(record), []).append(record)
    return groups


def by_model(records: Records) -> dict[str, list[RunRecord]]:
    """Return the records of each model."""
    return grouped(records, lambda record: record.model)


def by_set(records: Records) -> dict[str, list[RunRecord]]:
    """Return the records of each mission set."""
    return grouped(records, lambda record: record.mission_set)


def main_variant(records: Records) -> str:
    """Return the variant that tables by model speak of, "" without any run.

    It is the one that most models ran; among equals the reference, then `full`, then the one
    with the most runs.
    """
    variants = grouped(records, lambda record: record.variant)
    if not variants:
        return ""

    def rank(name: str) -> tuple[int, bool, bool, int]:
        runs = variants[name]
        return len(by_model(runs)), name == REFERENCE, name == "full", len(runs)

    return max(variants, key=rank)


def main_runs(records: Records) -> list[RunRecord]:
    """Return the runs of the main variant."""
    variant = main_variant(records)
    return [record for record in records if record.variant == variant]


def comparable_runs(records: Records) -> list[RunRecord]:
    """Return the runs of the main variant on the paper's own missions."""
    return [record for record in main_runs(records) if record.mission_set == MISSION_SET]


def needless_refusal(record: RunRecord) -> bool:
    """Return whether no order was given although one was needed.

    A command that holding or reporting fulfils was not refused by an order to hold or to report:
    the true state shows its success.
    """
    return record.refused and not record.strict and record.expect in ("execute", "trim")


def ablated_models(records: Records) -> list[str]:
    """Return the models that ran under two variants or more."""
    pairs = {(record.model, record.variant) for record in records}
    variants = Counter(model for model, _ in pairs)
    return [model for model in by_model(records) if variants[model] > 1]
