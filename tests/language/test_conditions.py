"""A condition comes to the same in a picture and in the digest of it."""

import random
from dataclasses import dataclass

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.language.canonical.facts import (
    DigestFacts,
    conditions,
    holds,
    is_free,
    sole_covers,
)
from pa_console.language.canonical.order import Condition, Fact, in_words
from pa_console.language.canonical.reading import plain_reading
from pa_console.schema.telemetry import Picture, Track
from pa_console.schema.world import AssetKind
from pa_training.situations.situations import random_situation, settled
from pa_training.situations.worlds import random_world, shipped_world

QUIET = settled(shipped_world())


@dataclass(frozen=True)
class PictureFacts:
    """The facts of a picture; None for gates and assets that are not in it."""

    picture: Picture

    def tracks(self, gate: str) -> list[Track]:
        """Return the tracks at a gate that do not leave."""
        tracks = self.picture.tracks.values()
        return [track for track in tracks if track.gate == gate and track.status != "leaving"]

    def is_covered(self, gate: str) -> bool | None:
        """Return whether a gate has a guard."""
        cover = self.picture.gates.get(gate)
        return None if cover is None else cover.covered

    def is_low(self, asset: str) -> bool | None:
        """Return whether the battery of an asset is low."""
        known = self.picture.assets.get(asset)
        return None if known is None else known.low_battery

    def is_up(self, asset: str) -> bool | None:
        """Return whether an asset works."""
        known = self.picture.assets.get(asset)
        return None if known is None else known.available

    def has_free(self, kind: AssetKind | None) -> bool:
        """Return whether an asset of a kind, or any, may be sent somewhere."""
        alone = {*sole_covers(self.picture).values()}
        team = (asset for asset in self.picture.assets.values() if kind in (None, asset.kind))
        return any(is_free(asset, alone) for asset in team)


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
    condition = Condition(fact=fact, subject="Nowhere_1")
    assert holds(condition, PictureFacts(QUIET.picture)) is not True


def test_every_condition_is_put_in_words_of_its_own() -> None:
    every = [*conditions(QUIET.world, QUIET.digest)]
    canonical = [in_words(condition) for condition in every]
    plain = [plain_reading(f"asked: if {words}: hold, else: nothing") for words in canonical]
    assert len({*canonical}) == len(every) == len({*plain})
    assert all("if " in said and ", stay put, otherwise do nothing" in said for said in plain)
    assert not any(words in said for words, said in zip(canonical, plain, strict=True))
