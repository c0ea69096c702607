"""STOP is answered, and holds every asset, whatever strangers do to the port."""

from tests.attacks.load_campaign import LOADS, campaign


def test_every_stop_is_answered_and_holds_every_asset_under_each_load() -> None:
    told, amiss = campaign(2, seed=0)
    assert len(told) == len(LOADS)
    assert not amiss, told
