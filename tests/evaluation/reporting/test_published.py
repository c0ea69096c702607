"""The paper's numbers agree with one another, and only stated ones are given as stated."""

import pytest

from pa_console.evaluation.reporting.statistics import (
    HYBRID_BY_CATEGORY,
    MODELS,
    published,
)
from pa_console.resources import data_folder
from pa_console.schema.document import Document
from pa_console.schema.evaluation import MissionSet

MISSIONS_BY_CATEGORY = {
    "Baseline": 2, "Unknown Events": 1, "Recovery": 2, "Multi-Event": 4, "Policy": 1,
}  # fmt: skip
"""The number of the ten missions in each category, which the paper does not give."""


@pytest.mark.parametrize("model", list(MODELS))
def test_table_one_comes_to_the_hybrid_success_of_each_model(model: str) -> None:
    won = sum(HYBRID_BY_CATEGORY[c][model] * n for c, n in MISSIONS_BY_CATEGORY.items())
    hybrid = published(model, "hybrid")
    assert hybrid is not None
    assert won / 10 == pytest.approx(hybrid.value)


def test_the_division_of_the_missions_is_the_only_one_that_table_one_allows() -> None:
    names = list(HYBRID_BY_CATEGORY)
    sizes = [
        division
        for division in _divisions(10, len(names))
        if all(
            (rate * count) % 1 == 0
            for name, count in zip(names, division, strict=True)
            for rate in HYBRID_BY_CATEGORY[name].values()
        )
    ]
    assert sizes == [tuple(MISSIONS_BY_CATEGORY[name] for name in names)]


def _divisions(total: int, parts: int) -> list[tuple[int, ...]]:
    if parts == 1:
        return [(total,)]
    return [
        (first, *rest)
        for first in range(1, total - parts + 2)
        for rest in _divisions(total - first, parts - 1)
    ]


def test_the_paper_set_is_divided_in_the_same_way() -> None:
    path = data_folder() / "worlds" / "checkpoint" / "missions" / "paper.yaml"
    counts: dict[str, int] = {}
    for mission in Document.read(path).parse(MissionSet).missions:
        counts[mission.category] = counts.get(mission.category, 0) + 1
    assert counts == MISSIONS_BY_CATEGORY


def test_what_only_follows_is_marked_and_what_is_unknown_is_missing() -> None:
    mistral = published("Mistral", "hybrid")
    assert mistral is not None
    assert (mistral.value, mistral.derived) == (pytest.approx(0.9), True)
    assert published("Mistral", "strict") is None
    assert published("LLaMA", "latency_s") is None
    stated = published("LLaMA", "strict")
    assert stated is not None
    assert not stated.derived
    assert all(published("nobody", "hybrid") is None for _ in MODELS)
