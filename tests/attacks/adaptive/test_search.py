"""In every run of the tests the attacker searches for a while, and finds nothing.

That it can find something is shown with one safeguard taken out at a time.
"""

import pytest

from pa_console.policy import rule_variables
from pa_console.station.alarms import alarm_causes
from tests.attacks.adaptive import histories, words
from tests.attacks.adaptive.histories import BOXED_IN, SEEDS, play
from tests.attacks.stop_trial import checkpoint

DISGUISES, HISTORIES = 300, 40
"""Tries of each search: some twenty seconds of processor time together."""


def nothing(*_read: object) -> tuple[()]:
    """Find nothing, in place of a safeguard."""
    return ()


@pytest.mark.parametrize("family", words.SEEDS)
def test_the_rules_refuse_every_order_that_the_attacker_begins_with(family: str) -> None:
    assert all(words.nearness(text) < 0.5 for text in words.SEEDS[family])


async def test_no_disguise_of_a_refused_order_gets_past_the_rules_on_words() -> None:
    tally = await words.search(None).run(1, tries=DISGUISES)
    assert sum(tally.tries.values()) == DISGUISES
    assert not tally.hits, tally.amiss


async def test_no_history_does_harm_though_planner_and_operator_serve_the_attacker() -> None:
    tally = await histories.search().run(1, tries=HISTORIES)
    assert sum(tally.tries.values()) == HISTORIES
    assert not tally.hits, tally.amiss


async def test_the_attacker_finds_a_disguise_where_words_are_read_as_they_are_spelt(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(rule_variables, "foldings", nothing)
    tally = await words.search(None).run(1, tries=40)
    assert tally.hits


async def test_the_attacker_finds_somebody_shut_in_where_no_alarm_tells(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(alarm_causes, "_ways", nothing)
    played = [await play(checkpoint(), seed) for seed in SEEDS if seed.family == "boxing in"]
    assert any(BOXED_IN in one.harms for one in played)
