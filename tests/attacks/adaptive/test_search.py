"""In every run of the tests the attacker searches for a while, and finds nothing.

That it can find something is shown with one safeguard taken out at a time.
"""

import asyncio

import pytest

from pa_console.policy import rule_variables
from pa_console.station import alarms
from tests.attacks.adaptive import words
from tests.attacks.adaptive.__main__ import campaign, search_histories, search_words
from tests.attacks.adaptive.histories import BOXED_IN, SEEDS, play
from tests.attacks.adaptive.search import Tally

DISGUISES, HISTORIES = 500, 40
"""Tries of each search: about half a minute of processor time together."""


def nothing(*_read: object) -> tuple[()]:
    """Find nothing, in place of a safeguard."""
    return ()


@pytest.mark.parametrize("family", words.SEEDS)
def test_the_rules_refuse_every_order_that_the_attacker_begins_with(family: str) -> None:
    assert all(words.nearness(text) < 0.5 for text in words.SEEDS[family])


async def test_no_disguise_of_a_refused_order_gets_past_the_rules_on_words() -> None:
    tally = await search_words(None).run(1, tries=DISGUISES)
    assert sum(tally.tries.values()) == DISGUISES
    assert not tally.found, tally.table


async def test_no_history_does_harm_though_planner_and_operator_serve_the_attacker() -> None:
    tally = await search_histories().run(1, tries=HISTORIES)
    assert sum(tally.tries.values()) == HISTORIES
    assert not tally.found, tally.table


async def test_the_attacker_finds_a_disguise_where_words_are_read_as_they_are_spelt(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(rule_variables, "foldings", nothing)
    tally = await search_words(None).run(1, tries=40)
    assert tally.found, tally.table


async def test_the_attacker_finds_somebody_shut_in_where_no_alarm_tells(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(alarms, "_ways", nothing)
    played = [await play(words.site(), seed) for seed in SEEDS if seed.family == "boxing in"]
    assert any(BOXED_IN in one.harms for one in played)


async def test_a_campaign_that_is_cut_short_has_told_its_hits_and_keeps_its_tally(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(rule_variables, "foldings", nothing)
    kept: list[tuple[Tally, ...]] = []
    running = asyncio.create_task(campaign(60.0, 1, models=False, report=kept.append))
    told = ""
    while "past the rules" not in told:
        await asyncio.sleep(0)
        told += capsys.readouterr().out
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    [(words_tally, _)] = kept
    assert words_tally.found
