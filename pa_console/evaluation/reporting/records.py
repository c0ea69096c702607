"""Groups of runs, and the paper's own results beside which they are shown.

O. Solanki, L. Praharaj, D. Gupta, M. Gupta, "A Policy-Aware Edge LLM-RAG Framework for Internet of
Battlefield Things Mission Orchestration", Section V. Its figures are not in the text that we have:
a value that only a figure would show is missing here, not guessed.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple, TypeVar

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


MISSION_SET = "paper"
"""The mission set that holds the paper's ten commands; only runs of it are comparable."""

MODELS = {
    "Gemma": "Gemma-2B",
    "LLaMA": "LLaMA-3.1-8B",
    "Mistral": "Mistral-7B",
    "Qwen": "Qwen-2.5-7B",
}
"""The paper's models by the short name of its Table I (Section V-A)."""

Quantity = Literal["hybrid", "strict", "latency_s", "precision", "recall", "f1"]


class Published(NamedTuple):
    """One number of the paper; `derived` when it follows from others that the text states."""

    value: float
    place: str
    derived: bool = False


HYBRID_BY_CATEGORY: dict[str, dict[str, float]] = {
    "Baseline": {"Gemma": 1.0, "LLaMA": 1.0, "Mistral": 1.0, "Qwen": 0.5},
    "Unknown Events": {"Gemma": 1.0, "LLaMA": 1.0, "Mistral": 1.0, "Qwen": 0.0},
    "Recovery": {"Gemma": 1.0, "LLaMA": 0.5, "Mistral": 0.5, "Qwen": 0.5},
    "Multi-Event": {"Gemma": 1.0, "LLaMA": 0.75, "Mistral": 1.0, "Qwen": 0.0},
    "Policy": {"Gemma": 1.0, "LLaMA": 1.0, "Mistral": 1.0, "Qwen": 0.0},
}
"""Table I: hybrid success by category and model."""

MISSIONS_BY_CATEGORY = {
    "Baseline": 2, "Unknown Events": 1, "Recovery": 2, "Multi-Event": 4, "Policy": 1,
}  # fmt: skip
"""The number of the ten missions in each category. The paper does not give it. With ten missions
and one run each, Table I leaves this division only: 75 % needs four missions or eight, 50 % needs
an even number in two further categories, and the other two hold one at least."""


def _overall(model: str) -> Published:
    """Return the hybrid success over all ten missions that Table I implies."""
    won = sum(HYBRID_BY_CATEGORY[name][model] * n for name, n in MISSIONS_BY_CATEGORY.items())
    return Published(won / sum(MISSIONS_BY_CATEGORY.values()), "follows from Table I", True)


_FIG3, _FIG4, _FIG5 = "caption of Fig. 3", "caption of Fig. 4", "caption of Fig. 5"

RESULTS: dict[str, dict[Quantity, Published]] = {
    "Gemma": {
        "hybrid": Published(1.0, _FIG3),
        "strict": Published(1.0, _FIG3),
        "latency_s": Published(4.17, _FIG4),
        "f1": Published(0.95, _FIG5),
    },
    "LLaMA": {"hybrid": Published(0.8, _FIG3), "strict": Published(0.7, _FIG3)},
    "Mistral": {"hybrid": _overall("Mistral")},
    "Qwen": {
        "hybrid": _overall("Qwen"),
        "latency_s": Published(6.79, _FIG4),
        "precision": Published(1.0, _FIG5),
        "recall": Published(0.78, _FIG5),
        "f1": Published(2 * 1.0 * 0.78 / (1.0 + 0.78), "follows from precision and recall", True),
    },
}
"""The published results of each model over all its missions."""


def published(model: str, quantity: Quantity) -> Published | None:
    """Return the paper's value of `quantity` for its `model`, None where its text gives none."""
    return RESULTS.get(model, {}).get(quantity)
