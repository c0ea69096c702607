"""Where an answer could have gone another way: allowed, really other, and the likeliest first."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from llguidance import LLMatcher

from pa_console.llm.local.decoding import branch_points
from tests.llm.test_grammar import BYTES

GRAMMAR = 'start: "go " ("north" | "south" | "norm" | "base") (" now" | " soon")'
PLACES, TIMES = ("north", "south", "norm", "base"), ("now", "soon")
WAYS = [f"go {place} {time}" for place in PLACES for time in TIMES]


@settings(deadline=None)
@given(st.sampled_from(WAYS), st.integers(0, 2**32 - 1), st.integers(0, 6), st.integers(1, 12))
def test_every_branch_is_another_way_to_begin(text: str, seed: int, begun: int, count: int) -> None:
    answer = BYTES.tokenize_str(text)
    rows = np.random.default_rng(seed).normal(size=(len(answer), BYTES.vocab_size))
    found = branch_points(
        LLMatcher(BYTES, GRAMMAR), BYTES, answer, rows.astype(np.float32), begun, count
    )
    assert len(found) <= count
    assert [branch.chance for branch in found] == sorted((b.chance for b in found), reverse=True)
    begins = [text[: branch.kept] + BYTES.decode_str([branch.token]) for branch in found]
    assert len(set(begins)) == len(begins)
    for branch, begin in zip(found, begins, strict=True):
        assert branch.kept >= begun
        assert not text.startswith(begin)
        assert any(way.startswith(begin) for way in WAYS)


def test_the_likeliest_way_comes_first() -> None:
    answer = BYTES.tokenize_str("go north now")
    rows = np.full((len(answer), BYTES.vocab_size), -9.0, np.float32)
    (norm,), (south,) = BYTES.tokenize_str("m"), BYTES.tokenize_str("s")
    for row, token in zip(rows, answer, strict=True):
        row[token] = 9.0
    rows[3, south], rows[6, norm] = 4.0, 6.0
    found = branch_points(LLMatcher(BYTES, GRAMMAR), BYTES, answer, rows, 0, 2)
    assert [(branch.kept, branch.token) for branch in found] == [(6, norm), (3, south)]
    later = branch_points(LLMatcher(BYTES, GRAMMAR), BYTES, answer, rows, 4, 2)
    assert [(branch.kept, branch.token) for branch in later][:1] == [(6, norm)]
