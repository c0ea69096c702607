"""The paper's hybrid retrieval: scores, order, pinned rules, whatever the text."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.policy.retriever import Retriever
from pa_console.schema.rule import Rule
from tests.policy.book import checkpoint_rules

RULES = checkpoint_rules().rules
CRITICAL = {rule.id for rule in RULES if rule.priority == "critical"}
RETRIEVER = Retriever(RULES)
TEXT = st.one_of(st.text(max_size=80), st.sampled_from([rule.text for rule in RULES]))


@given(TEXT)
def test_every_rule_is_scored_once_between_0_and_1_best_first(text: str) -> None:
    hits = RETRIEVER.score_all(text)
    assert sorted(hit.rule_id for hit in hits) == sorted(rule.id for rule in RULES)
    order = [(-hit.score, hit.rule_id) for hit in hits]
    assert order == sorted(order)
    for hit in hits:
        assert set(hit.components) == {"fuzzy", "jaccard"}
        assert all(0.0 <= value <= 1.0 for value in hit.components.values())
        assert hit.score == pytest.approx(sum(hit.components.values()) / 2)


@given(TEXT, st.integers(0, 40))
def test_pinned_rules_come_first_and_k_others_follow(text: str, k: int) -> None:
    hits = RETRIEVER.retrieve(text, k)
    ids = [hit.rule_id for hit in hits]
    assert len(ids) == len(set(ids))
    assert set(ids[: len(CRITICAL)]) == CRITICAL
    assert [hit.pinned for hit in hits] == [hit.rule_id in CRITICAL for hit in hits]
    assert len(ids) - len(CRITICAL) == min(k, len(RULES) - len(CRITICAL))
    others = [h.rule_id for h in RETRIEVER.score_all(text) if h.rule_id not in CRITICAL]
    assert ids[len(CRITICAL) :] == others[:k]


@given(TEXT)
def test_the_same_text_always_gives_the_same_rules_whatever_their_order_in_the_file(
    text: str,
) -> None:
    assert Retriever(reversed(RULES)).retrieve(text) == RETRIEVER.retrieve(text)


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.id)
def test_a_rule_s_own_text_finds_it_in_any_case(rule: Rule) -> None:
    best = RETRIEVER.score_all(rule.text.upper())[0]
    assert best.rule_id == rule.id
    assert best.score == pytest.approx(1.0)


def test_both_components_are_computed_as_described() -> None:
    rule = Rule(id="WF-01", domain="WF", priority="high", text="Watch the north gate")
    (hit,) = Retriever([rule]).score_all("watch the east gate")
    assert hit.components["jaccard"] == pytest.approx(3 / 5)
    assert hit.components["fuzzy"] == pytest.approx(2 * 16 / (20 + 19))


def test_a_negative_number_and_an_unknown_method_are_refused() -> None:
    with pytest.raises(ValueError, match="-1"):
        RETRIEVER.retrieve("hold", -1)
    with pytest.raises(ValueError, match="known: paper"):
        Retriever(RULES, "oracle")
