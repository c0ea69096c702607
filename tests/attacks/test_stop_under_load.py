"""STOP is answered, and holds every asset, whatever strangers do to the port."""

from tests.attacks.load_campaign import LOADS, campaign

STOPS = 2


def test_every_stop_is_answered_and_holds_every_asset_under_each_load() -> None:
    found = campaign(STOPS, seed=0)
    assert [under.load for under in found] == list(LOADS)
    for under in found:
        assert len(under.answered_ms) == len(under.held_ms) == STOPS, under.summary()
        assert under.short == 0, under.summary()
