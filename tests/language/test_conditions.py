"""A condition comes to the same in a picture and in the digest of it."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.language.canonical.facts import DigestFacts, conditions, holds
from pa_console.language.canonical.order import Condition, Fact, in_words
from pa_console.language.canonical.reading import plain_reading
from pa_training.order_generator.orders import PictureFacts, is_so
from pa_training.situations.situations import random_situation, settled
from pa_training.situations.worlds import random_world, shipped_world

QUIET = settled(shipped_world())


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6))
def test_picture_and_digest_decide_alike(seed: int) -> None:
    rng = random.Random(seed)
    there = random_situation(rng, random_world(rng))
    seen, told = PictureFacts(there.picture), DigestFacts(there.digest)
    for condition in conditions(there.world, there.digest):
        truth = holds(condition, told)
        if truth is None:
            assert condition.fact in ("low", "not_low")
            assert not there.picture.assets[condition.subject].available
        else:
            assert truth is holds(condition, seen), condition


@pytest.mark.parametrize("fact", ["uncovered", "covered", "low", "not_low", "down", "up"])
def test_nothing_is_so_of_what_is_not_there(fact: Fact) -> None:
    assert not is_so(Condition(fact=fact, subject="Nowhere_1"), QUIET.picture)


def test_every_condition_is_put_in_words_of_its_own() -> None:
    every = [*conditions(QUIET.world, QUIET.digest)]
    canonical = [in_words(condition) for condition in every]
    plain = [plain_reading(f"asked: if {words}: hold, else: nothing") for words in canonical]
    assert len({*canonical}) == len(every) == len({*plain})
    assert all("if " in said and ", stay put, otherwise do nothing" in said for said in plain)
    assert not any(words in said for words, said in zip(canonical, plain, strict=True))
