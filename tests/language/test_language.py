"""Orders are written, read, constrained and told in plain words by one table of clauses."""

import re

import pytest
from pydantic import ValidationError

from pa_console.language.canonical.clauses import CLAUSES, written
from pa_console.language.canonical.reading import plain_reading, read_asked
from pa_console.language.clause_grammar import asked_pattern
from pa_console.language.name_linking import link_names
from pa_console.schema.world import World
from pa_training.situations.worlds import shipped_world
from tests.written import SITUATIONS, given


@pytest.mark.parametrize("number", range(1, SITUATIONS, 3))
def test_a_model_may_write_what_every_order_asks(number: int) -> None:
    there = given(number).situation
    for one in given(number).orders:
        pattern = asked_pattern(there.world, there.digest, one.text, facts=False)
        assert re.fullmatch(pattern, one.order.asked), one


@pytest.mark.parametrize("number", range(1, SITUATIONS, 3))
def test_nothing_but_names_is_left_of_the_canonical_words(number: int) -> None:
    for one in given(number).orders:
        plain = plain_reading(f"asked: {one.meaning}")
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


def test_what_people_call_a_place_or_an_asset_is_its_name() -> None:
    aliases = {"yard": "Checkpoint", "old betsy": "Ugv_T01"}
    world = shipped_world().model_copy(update={"aliases": aliases})
    assert link_names(world, "Old Betsy to the yard.") == "Ugv_T01 to the Checkpoint."
    assert link_names(world, "The yardstick is at the north gate.").startswith("The yardstick")


@pytest.mark.parametrize(
    ("aliases", "wrong"),
    [
        ({"yard": "Yard"}, "'Yard' is neither an asset nor a place"),
        ({"north gate": "Base"}, "already has this name"),
        ({"The Yard": "Base"}, "should match pattern"),
    ],
)
def test_an_alias_that_cannot_be_is_named(aliases: dict[str, str], wrong: str) -> None:
    described = shipped_world().model_dump() | {"aliases": aliases}
    with pytest.raises(ValidationError, match=wrong):
        World.model_validate(described)
