"""Orders of writers who are kept aside, with what they ask, and plans that are right for them."""

from functools import cache
from typing import NamedTuple

from pa_console.language.canonical.clauses import NOTHING
from pa_console.policy.rulebook import load_rules
from pa_console.resources import data_folder
from pa_training.orders.meaning import Order, meaning_now, order_of
from pa_training.samples.groups import Group, Recipe, make_group, recipes, situation_of
from pa_training.situations.situations import Situation
from pa_training.situations.worlds import generated_numbers, shipped_missions

SITUATIONS = 40
"""The situations of the writers that tests draw from."""


class GivenOrder(NamedTuple):
    """An order in a writer's words, its meaning in canonical words, and the tasks it asks for."""

    text: str
    meaning: str
    order: Order


class Given(NamedTuple):
    """A situation and the orders that a writer gave in it."""

    situation: Situation
    orders: tuple[GivenOrder, ...]


@cache
def given(number: int) -> Given:
    """Return the orders in one of `SITUATIONS` that are for a single plan."""
    recipe = _recipes()[number % SITUATIONS]
    there = situation_of(recipe, generated_numbers(shipped_missions()))
    orders = list[GivenOrder]()
    for written in recipe.written.first_orders:
        meaning = meaning_now(written.meaning)
        if meaning and meaning != NOTHING:
            try:
                order = order_of(meaning, there.world, there.digest)
            except ValueError:  # a condition about a place where sensors show nothing
                continue
            orders.append(GivenOrder(written.text, meaning, order))
    return Given(there, tuple(orders))


@cache
def proven(number: int) -> Group:
    """Return six orders in one of `SITUATIONS` with plans that were proven right."""
    rulebook = load_rules(data_folder() / "rules" / "checkpoint.yaml")
    recipe = _recipes()[number % SITUATIONS]._replace(plans=6)
    return make_group(recipe, rulebook, generated_numbers(shipped_missions()))


@cache
def _recipes() -> tuple[Recipe, ...]:
    return tuple(recipes("development"))[:SITUATIONS]
