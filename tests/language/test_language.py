"""Orders are written, read, constrained and told in plain words by one table of clauses."""

import random
import re
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from pa_console.language.canonical.clauses import CLAUSES, NOWHERE, written
from pa_console.language.canonical.order import Ask, Who
from pa_console.language.canonical.reading import plain_reading, read_asked
from pa_console.language.clause_grammar import asked_pattern
from pa_console.language.name_linking import link_names
from pa_console.schema.world import World
from pa_training.order_generator.orders import (
    Order,
    canonical_clause,
    canonical_meaning,
    canonical_order,
    due_asks,
)
from pa_training.order_generator.sampler import sample_order
from pa_training.phrasing.phrasing import phrase
from pa_training.situations.situations import Situation, random_situation
from pa_training.situations.worlds import random_world, shipped_world

_SAID_WRONG = {
    "force", "chase", "strip", "override", "skip_identification", "skip_warning", "noncombatants",
}  # fmt: skip
_OF_TRACKS = ("identify", "warn", "respond")
SEEDS = st.integers(0, 10**6)


def drawn(seed: int, count: int = 6) -> tuple[Situation, random.Random, list[Order]]:
    rng = random.Random(seed)
    there = random_situation(rng, random_world(rng))
    world, picture, digest = there.world, there.picture, there.digest
    return there, rng, [sample_order(rng, world, picture, digest)[0] for _ in range(count)]


def told(ask: Ask, world: World) -> Ask:
    """Return as much of `ask` as the language of orders has words for."""
    known = ask.place in world.frames or ask.place in world.zones
    place = ask.place if known else NOWHERE
    if ask.wrong in _SAID_WRONG:
        where = place if ask.place and ask.wrong in ("force", "strip") else ""
        return Ask(task="refused", place=where, wrong=ask.wrong)
    who = Who(names=ask.who.names) if ask.who.names else ask.who
    if ask.task in ("respond", "stand_down"):
        who = Who()
    said = replace(ask, who=who, place=place, wrong=None, strict_who=False)
    if ask.task in ("home", "swap", "hold") or (ask.task == "report" and not ask.place):
        said = replace(said, place="")
    if ask.task == "cover":
        said = replace(said, leaving="")
    if ask.task not in _OF_TRACKS or ask.track_id:
        said = replace(said, track="")
    return said if ask.task in _OF_TRACKS else replace(said, track_id="")


@settings(max_examples=30, deadline=None)
@given(SEEDS)
def test_what_is_written_is_read_again(seed: int) -> None:
    there, _, orders = drawn(seed)
    for order in orders:
        words = canonical_order(order, there.world, there.picture, there.digest)
        reading = read_asked(f"asked: {words}")
        assert reading is not None
        assert reading.others_stay == order.others_stay
        due = due_asks(order, there.picture)
        assert [replace(ask, words="") for ask in reading.asks] == [
            told(ask, there.world) for ask in due
        ]


@settings(max_examples=30, deadline=None)
@given(SEEDS)
def test_what_was_read_is_written_in_the_same_words(seed: int) -> None:
    there, _, orders = drawn(seed)
    for order in orders:
        for ask in (*order.asks, *order.otherwise):
            words = canonical_clause(ask, there.world)
            reading = read_asked(f"asked: {words}")
            assert reading is not None
            (read,) = reading.asks
            assert read.words == words
            if read.task != "refused":
                assert canonical_clause(read, there.world) == words


@settings(max_examples=15, deadline=None)
@given(SEEDS)
def test_a_model_may_write_every_order_that_there_can_be(seed: int) -> None:
    there, rng, orders = drawn(seed)
    for order in orders:
        words = phrase(order, there.world, there.picture, rng).text
        pattern = asked_pattern(there.world, there.digest, words, facts=False)
        asked = canonical_order(order, there.world, there.picture, there.digest)
        assert re.fullmatch(pattern, f"asked: {asked}"), asked


@settings(max_examples=15, deadline=None)
@given(SEEDS)
def test_nothing_but_names_is_left_of_the_canonical_words(seed: int) -> None:
    there, _, orders = drawn(seed)
    for order in orders:
        plain = plain_reading(f"asked: {canonical_meaning(order, there.world)}")
        assert not re.search(r"stand down|swap|\bhold\b|relieves|uncovered| free$|else:", plain)


def test_every_clause_has_a_task_that_can_be_written_and_read() -> None:
    said = {
        "who": "Drone_T01", "place": "EastGate", "gate": "EastGate", "first": "A_1",
        "second": "A_2", "guard": "A_1 at EastGate",
    }  # fmt: skip
    for clause in CLAUSES:
        words = written(clause.task, said, clause.wrong)
        reading = read_asked(f"asked: {words}")
        assert reading is not None
        assert [(ask.task, ask.wrong) for ask in reading.asks] == [(clause.task, clause.wrong)]


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (Ask(task="go"), "somebody to unknown place"),
        (Ask(task="home"), "somebody home"),
        (Ask(task="warn"), "warn at unknown place"),
        (Ask(task="block", place="EastGate", track_id="Track_01"), "block EastGate"),
        (Ask(task="warn", place="EastGate", track_id="Track_01"), "warn Track_01 at EastGate"),
        (Ask(task="relieve", leaving="Drone_T01"), "relieve Drone_T01"),
        (Ask(task="home", wrong="strip"), "leave all gates without guard"),
        (Ask(task="block", place="EastGate", wrong="force"), "use force at EastGate"),
        (Ask(task="hold", wrong="override"), "set rules aside, hold"),
    ],
)
def test_what_is_left_open_is_written_so(ask: Ask, words: str) -> None:
    assert canonical_clause(ask, shipped_world()) == words


def test_what_people_call_a_place_or_an_asset_is_its_name() -> None:
    aliases = {"yard": "Checkpoint", "old betsy": "Ugv_T01"}
    world = shipped_world().model_copy(update={"aliases": aliases})
    assert link_names(world, "Old Betsy to the yard.") == "Ugv_T01 to the Checkpoint."
    assert link_names(world, "The yardstick is at the north gate.").startswith("The yardstick")


@pytest.mark.parametrize(
    ("aliases", "wrong"),
    [
        ({"yard": "Yard"}, "'Yard' is no asset and no place"),
        ({"north gate": "Base"}, "has this name already"),
        ({"The Yard": "Base"}, "should match pattern"),
    ],
)
def test_an_alias_that_cannot_be_is_named(aliases: dict[str, str], wrong: str) -> None:
    described = shipped_world().model_dump() | {"aliases": aliases}
    with pytest.raises(ValidationError, match=wrong):
        World.model_validate(described)
