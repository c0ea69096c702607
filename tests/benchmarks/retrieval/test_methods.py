"""How retrieval is measured: the measures, the made-up rules, and a small bench."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.policy.retriever import METHODS
from tests.benchmarks.retrieval.distractors import MOST, distractors
from tests.benchmarks.retrieval.quality import (
    QUERIES,
    Estimate,
    Quality,
    RetrievalQuery,
    estimates,
    load_queries,
    quality,
)
from tests.benchmarks.retrieval.retrieval import bench_retrieval
from tests.policy.book import checkpoint_rules

RULES = tuple(rule for rule in checkpoint_rules().rules if rule.in_prompts)
IDS = [rule.id for rule in RULES]
QUERY = RetrievalQuery(
    id="q", split="dev", style="terse", text="hold", relevant={"WF-01": 2, "WF-02": 2, "WF-03": 1}
)


def test_the_measures_of_a_ranking_are_those_of_their_definitions() -> None:
    found = quality(QUERY, ["CAP-01", "WF-01", "CAP-02", "WF-03", *(["CAP-03"] * 6), "WF-02"])
    ideal = 3 + 3 / math.log2(3) + 1 / 2
    assert found.recall_3 == found.recall_10 == 0.5
    assert found.mrr == 0.5
    assert found.ndcg_10 == pytest.approx((3 / math.log2(3) + 1 / math.log2(5)) / ideal)


@given(st.permutations(IDS))
def test_the_ideal_order_is_the_best_and_every_measure_is_a_share(ranking: list[str]) -> None:
    ideal = quality(QUERY, ["WF-02", "WF-01", "WF-03"])
    assert ideal == Quality(1.0, 1.0, 1.0, 1.0)
    assert all(0.0 <= value <= 1.0 for value in quality(QUERY, ranking))
    assert quality(QUERY, []) == Quality(0.0, 0.0, 0.0, 0.0)


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=30))
def test_an_interval_lies_within_the_values_and_is_the_same_every_time(values: list[float]) -> None:
    found = [Quality(value, 1.0, 0.0, value) for value in values]
    first, one, none, _ = estimates(found)
    assert first.mean == pytest.approx(sum(values) / len(values))
    assert min(values) - 1e-9 <= first.low <= first.high <= max(values) + 1e-9
    assert (one, none) == (Estimate(1.0, 1.0, 1.0), Estimate(0.0, 0.0, 0.0))
    assert estimates(found) == estimates(found)


def test_made_up_rules_are_all_different_repeatable_and_never_one_of_the_rule_file() -> None:
    made = distractors(5000, seed=3)
    assert made == distractors(5000, seed=3)
    assert made != distractors(5000, seed=4)
    assert len({rule.text for rule in made}) == len({rule.id for rule in made}) == 5000
    assert not {rule.text.casefold() for rule in made} & {rule.text.casefold() for rule in RULES}
    assert not {rule.id for rule in made} & set(IDS)
    with pytest.raises(ValueError, match="only"):
        distractors(MOST + 1)


def test_made_up_rules_share_their_words_with_the_real_ones() -> None:
    made = {word.strip(".").lower() for rule in distractors(2000) for word in rule.text.split()}
    real = {word.strip(".,").lower() for rule in RULES for word in rule.text.split()}
    assert len(made & real) > 40


def test_the_bench_measures_every_method_at_every_size() -> None:
    queries = load_queries(QUERIES, RULES).queries[:40]
    told: list[str] = []
    sizes = (len(RULES), 300)
    rows = bench_retrieval(RULES, queries, METHODS, sizes, lambda what, _: told.append(what))
    assert [(row.rules, row.method) for row in rows] == [(n, m) for n in sizes for m in METHODS]
    assert len(told) == len(rows)
    for small, large in zip(rows[: len(METHODS)], rows[len(METHODS) :], strict=True):
        assert [q.queries for q in small.quality if not q.style] == [20, 20]
        assert {q.style for q in small.quality if q.style} == {query.style for query in queries}
        assert 0 < small.kept_bytes <= small.peak_bytes < large.peak_bytes
        assert 0.0 < small.median_s <= small.p95_s
