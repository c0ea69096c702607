"""The orders that untrained models are shown: about other worlds, readable, the nearest last."""

import pytest

from pa_console.language.canonical.clauses import ASKED
from pa_console.language.canonical.reading import read_asked
from pa_console.llm.roles.clause_reader import nearest_orders, taught_orders, without_names
from pa_training.orders.near_duplicates import shipped_duplicates


def test_every_taught_order_is_in_clauses_that_the_console_reads() -> None:
    orders, masked = taught_orders()
    assert len(orders) == len(masked) > 500
    for order in orders:
        reading = read_asked(f"{ASKED}{order.clauses}")
        assert reading is not None, order
        assert reading.readable, order


def test_none_is_like_a_mission_of_a_test_set() -> None:
    orders, _ = taught_orders()
    kept = shipped_duplicates().keep([order.text for order in orders])
    assert kept.count(False) <= len(orders) / 500


def test_an_order_that_was_taught_is_its_own_nearest() -> None:
    orders, _ = taught_orders()
    for order in orders[::200]:
        found = nearest_orders(order.text, 4)
        assert len(found) == 4
        assert without_names(found[-1].text) == without_names(order.text)


@pytest.mark.parametrize("name", ["Kite_3", "MillGate", "Drone_T04", "Track_01"])
def test_names_make_no_order_like_another(name: str) -> None:
    assert without_names(f"Send {name} home") == "send # home"
