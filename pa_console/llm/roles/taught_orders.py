"""Orders in operators' words with what they ask, and which of them are most like an order.

A model that was not trained for orders is shown the nearest ones: with these it reads far better
than with the same few for every order. They are written by the generator of the training data
(`training/samples/taught_orders.py`) and are about other worlds than those of any mission set.
"""

import re
from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

from rapidfuzz import fuzz, process

from pa_console.resources import data_folder
from pa_console.schema.document import DocumentError, read_text

FILE = "taught_orders.tsv"
"""Beside the catalogue of models: an order and its clauses on a line, parted by a tab."""
_NAME = re.compile(r"\b\w*(?:_\w|\d|[a-z][A-Z])\w*\b")
"""The form of a world's names: Drone_T04, EastGate."""


class TaughtOrder(NamedTuple):
    """An order with its world's names, and its reading."""

    text: str
    clauses: str


def nearest_orders(text: str, count: int) -> list[TaughtOrder]:
    """Return the `count` taught orders whose words are most like those of `text`, the nearest last.

    Names count as names only: which asset or place is meant makes no order like another. Raises
    DocumentError where the file is missing or broken.
    """
    orders, masked = taught_orders()
    found = process.extract(
        without_names(text), masked, scorer=fuzz.token_set_ratio, limit=count, processor=None
    )
    return [orders[place] for _, _, place in reversed(found)]


def without_names(text: str) -> str:
    """Return `text` in small letters, with one mark for every name in it."""
    return _NAME.sub("#", text).lower()


@cache
def taught_orders() -> tuple[Sequence[TaughtOrder], Sequence[str]]:
    """Return the taught orders, and their words without names; raises DocumentError."""
    path = data_folder() / "models" / FILE
    orders: list[TaughtOrder] = []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        text, tab, clauses = line.partition("\t")
        if not (text and tab and clauses):
            raise DocumentError(str(path), number, "", "write an order, a tab, and its clauses")
        orders.append(TaughtOrder(text, clauses))
    return orders, [without_names(order.text) for order in orders]
