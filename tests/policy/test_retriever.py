"""Retrieval by every method: order, pinned rules, bounds, whatever the text."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.policy.related_words import (
    Floats,
    Groups,
    Spelling,
    Vocabulary,
    default_vocabulary,
    load_vocabulary,
    ngrams,
    words_of,
)
from pa_console.policy.retriever import DEFAULT_METHOD, METHODS, Retriever
from pa_console.schema.document import DocumentError
from pa_console.schema.rule import Rule
from tests.policy.book import checkpoint_rules

RULES = tuple(rule for rule in checkpoint_rules().rules if rule.in_prompts)
CRITICAL = {rule.id for rule in RULES if rule.priority == "critical"}
RETRIEVERS = {method: Retriever(RULES, method) for method in METHODS}
BACKWARD = {method: Retriever(reversed(RULES), method) for method in METHODS}
METHOD = st.sampled_from(METHODS)
TEXT = st.one_of(
    st.text(max_size=80),
    st.sampled_from([rule.text for rule in RULES]),
    st.lists(st.sampled_from(["drone", "ugv", "block", "gate", "who", "the", "kill"])).map(
        " ".join
    ),
    st.sampled_from(
        ["", " \t\n", "Следи за воротами", "東の門を監視せよ", "مراقبة البوابة", "ẞß İ"]
    ),
)


def _rule(number: int, text: str, *tags: str) -> Rule:
    return Rule(id=f"WF-{number:02}", domain="WF", priority="high", text=text, tags=tags)


@given(METHOD, TEXT)
def test_every_rule_is_scored_once_between_0_and_its_parts_best_first(
    method: str, text: str
) -> None:
    hits = RETRIEVERS[method].score_all(text)
    assert sorted(hit.rule_id for hit in hits) == sorted(rule.id for rule in RULES)
    order = [(-hit.score, hit.rule_id) for hit in hits]
    assert order == sorted(order)
    for hit in hits:
        assert hit.components
        assert all(value >= 0.0 for value in hit.components.values())
        parts = sum(hit.components.values()) / (2 if method == "paper" else 1)
        assert hit.score == pytest.approx(parts, abs=2e-9)


@given(METHOD, TEXT, st.integers(0, 40))
def test_pinned_rules_come_first_and_the_k_best_others_follow(
    method: str, text: str, k: int
) -> None:
    retriever = RETRIEVERS[method]
    hits = retriever.retrieve(text, k)
    ids = [hit.rule_id for hit in hits]
    assert len(ids) == len(set(ids))
    assert set(ids[: len(CRITICAL)]) == CRITICAL
    assert [hit.pinned for hit in hits] == [hit.rule_id in CRITICAL for hit in hits]
    assert len(ids) - len(CRITICAL) == min(k, len(RULES) - len(CRITICAL))
    every = retriever.score_all(text)
    assert list(hits) == [h for h in every if h.pinned] + [h for h in every if not h.pinned][:k]
    assert list(retriever.rank(text, k)) == [hit.rule_id for hit in every][:k]


@given(METHOD, TEXT)
def test_the_same_text_always_gives_the_same_rules_whatever_their_order_in_the_file(
    method: str, text: str
) -> None:
    assert BACKWARD[method].score_all(text) == RETRIEVERS[method].score_all(text)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.id)
def test_a_rule_s_own_text_finds_it_in_any_case(rule: Rule, method: str) -> None:
    assert RETRIEVERS[method].rank(rule.text.upper(), 1) == (rule.id,)


@pytest.mark.parametrize("method", METHODS)
def test_any_number_of_rules_and_any_length_of_text_will_do(method: str) -> None:
    assert Retriever([], method).retrieve("watch the gate", 3) == ()
    (hit,) = Retriever([RULES[0]], method).retrieve("watch the gate", 3)
    assert hit.rule_id == RULES[0].id
    long = " ".join(f"word{number} gate" for number in range(2000))
    assert len(RETRIEVERS[method].retrieve(long, 5)) == len(CRITICAL) + 5


def test_both_parts_of_the_paper_s_score_are_computed_as_described() -> None:
    (hit,) = Retriever([_rule(1, "Watch the north gate")], "paper").score_all("watch the east gate")
    assert hit.components["jaccard"] == pytest.approx(3 / 5)
    assert hit.components["fuzzy"] == pytest.approx(2 * 16 / (20 + 19))


def test_rules_are_found_by_rare_words_before_common_ones() -> None:
    rules = [_rule(1, "gate gate report"), _rule(2, "gate open lamp"), _rule(3, "gate close bell")]
    for method in METHODS:
        assert Retriever(rules, method).rank("gate bell", 1) == ("WF-03",)


@pytest.mark.parametrize(
    ("text", "rule_id"),
    [
        ("the quadcopter is nearly out of fuel", "CAP-04"),
        ("kill him", "ROE-01"),
        ("whose camera data is this based on? explain", "WF-10"),
        ("chase them beyond the fence", "ROE-06"),
        ("comms with that robot are flaky", "CAP-05"),
        ("batery low", "CAP-04"),
    ],
)
def test_the_default_method_knows_other_words_and_slips_of_the_keyboard(
    text: str, rule_id: str
) -> None:
    assert rule_id in RETRIEVERS[DEFAULT_METHOD].rank(text, 3)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("text", ["Move the drone to the east gate.", "kill him", "batery low"])
def test_a_processor_with_other_last_digits_gives_the_same_hits(
    method: str, text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    hits, log1p = Retriever(RULES, method).score_all(text), np.log1p
    for towards in (-np.inf, np.inf):

        def other(values: Floats, towards: float = towards) -> Floats:
            return np.nextafter(log1p(values), towards)

        monkeypatch.setattr(np, "log1p", other)
        assert Retriever(RULES, method).score_all(text) == hits


def test_related_words_count_less_than_the_same_word_and_only_if_the_vocabulary_has_them() -> None:
    rules = [_rule(1, "Lamps burn"), _rule(2, "Lanterns burn"), _rule(3, "Bells ring")]
    knowing = Vocabulary(name="lights", groups={"light": ("torch", "lamps", "lanterns")})
    assert [hit.score for hit in Retriever(rules, "related", Vocabulary()).score_all("torch")] == [
        0.0, 0.0, 0.0,
    ]  # fmt: skip
    found = {h.rule_id: h for h in Retriever(rules, "related", knowing).score_all("torch")}
    assert found["WF-01"].score == found["WF-02"].score == found["WF-01"].components["related"] > 0
    assert found["WF-03"].score == 0.0
    same = Retriever(rules, "related", knowing).score_all("lanterns")
    assert [hit.rule_id for hit in same] == ["WF-02", "WF-01", "WF-03"]


def test_a_negative_number_and_an_unknown_method_are_refused() -> None:
    with pytest.raises(ValueError, match="-1"):
        RETRIEVERS[DEFAULT_METHOD].retrieve("hold", -1)
    with pytest.raises(ValueError, match="known: paper, bm25"):
        Retriever(RULES, "oracle")


def test_among_many_rules_on_a_thing_those_with_the_mission_s_own_word_come_first() -> None:
    rules = [_rule(number, f"drones of store {number} stay clean") for number in range(10, 60)]
    rules.append(_rule(99, "uavs of store 99 stay clean"))
    assert Retriever(rules).rank("uavs", 1) == ("WF-99",)
    assert Retriever(rules).rank("quadcopter", 51) == tuple(rule.id for rule in rules)


def test_retrieval_does_not_score_worse_for_names_put_together() -> None:
    apart, together = "drone at the east gate", "Drone_T01 at EastGate"
    for rule in ("CAP-01", "WF-03"):
        assert rule in RETRIEVERS[DEFAULT_METHOD].rank(apart, 10)
        assert rule in RETRIEVERS[DEFAULT_METHOD].rank(together, 10)


WORDS = ("watch", "watches", "battery", "gate")
LIGHTS = Vocabulary(name="lights", groups={"light": ("lamp", "torch"), "fire": ("torch",)})


def test_the_installed_vocabulary_names_no_rule_and_no_place_of_one_world() -> None:
    words = {word for words in default_vocabulary().groups.values() for word in words}
    assert all(words_of(word) == [word] for word in words)
    assert not any(digit in word for word in words for digit in "0123456789")


@pytest.mark.parametrize(
    ("text", "field", "line"),
    [
        ("name: v\ngroups:\n  a: [gate, of]\nignored: [of]\n", "groups.a.1", 3),
        ("name: v\ngroups:\n  a:\n    - north gate\n", "groups.a.0", 4),
        ("name: v\ngroups:\n  a: [gate, off]\n", "groups.a.1", 3),
        ("name: v\nwords: []\n", "words", 2),
    ],
)
def test_a_wrong_vocabulary_is_refused_with_its_line_and_field(
    tmp_path: Path, text: str, field: str, line: int
) -> None:
    path = tmp_path / "words.yaml"
    path.write_text(text)
    with pytest.raises(DocumentError) as caught:
        load_vocabulary(path)
    assert (caught.value.field, caught.value.line) == (field, line)


def test_a_word_fits_every_group_it_is_in_and_one_spelt_alike_fits_less() -> None:
    groups = Groups(LIGHTS)
    assert groups.fit("torch").tolist() == [1.0, 1.0]
    assert groups.fit("lamp").tolist() == [1.0, 0.0]
    light, fire = groups.fit("lamps")
    assert 0.6 <= light < 1.0
    assert fire == 0.0
    assert not groups.fit("gate").any()


@given(st.one_of(st.sampled_from(WORDS), st.text(min_size=1, max_size=12)))
def test_a_word_is_most_like_itself(word: str) -> None:
    alike = Spelling(WORDS).likeness(word)
    assert ((alike >= 0.0) & (alike <= 1.0)).all()
    if word in WORDS:
        assert alike.argmax() == WORDS.index(word)
        assert alike.max() == 1.0


def test_an_ending_and_a_slip_are_more_alike_than_another_word() -> None:
    spelling = Spelling(WORDS)
    for word, place in (("watching", 0), ("batery", 2), ("gtate", 3)):
        assert spelling.likeness(word).argmax() in (place, place + 1)


def test_names_are_taken_apart_as_they_are_put_together() -> None:
    assert words_of("Drone_T01 to EastGate, NOW") == ["drone", "t01", "to", "east", "gate", "now"]
    assert words_of("Следи за 東門") == ["следи", "за", "東門"]
    assert words_of("") == []


def test_the_ends_of_a_word_are_part_of_its_ngrams() -> None:
    assert len(ngrams("gate", 3, 3)) == 4
    assert not set(ngrams("gate", 3, 3)) & set(ngrams("agatea", 3, 3)) - {"gat", "ate"}
