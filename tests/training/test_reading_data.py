"""Orders that are only to be read: what they ask for is known, and no plan is carried out."""

import gzip
import random
from pathlib import Path

import pytest
from pa_training.phrasing.no_orders import NOTHING_ASKED, NoOrders
from pa_training.samples.planner_samples import Recipe
from pa_training.samples.reading_samples import write_readings

from pa_console.language.canonical.reading import read_asked
from pa_console.resources import find_data
from pa_training.samples.sample import Sample
from pa_training.situations.worlds import shipped_world

RULES = find_data("rules", "checkpoint", "rules.yaml")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> list[Sample]:
    file = tmp_path_factory.mktemp("readings") / "r.jsonl.gz"
    recipes = [Recipe(number, 77, 6, wordings=2) for number in range(3)]
    assert all(write_readings(file, recipes, RULES, 1))
    with gzip.open(file, "rt", encoding="utf-8") as stream:
        return [Sample.model_validate_json(line) for line in stream]


def test_every_sample_begins_with_what_is_asked_and_stops_there(made: list[Sample]) -> None:
    orders = [sample for sample in made if not sample.kind.startswith("nothing/")]
    assert len(orders) > 20
    for sample in orders:
        if sample.goes_on:
            begun = sample.answer.partition('": "')[2].rpartition("; ")[0]
            assert read_asked(begun) is not None, sample.answer


def test_texts_that_ask_for_nothing_are_said_to(made: list[Sample]) -> None:
    nothing = [sample for sample in made if sample.kind.startswith("nothing/")]
    assert nothing
    assert all(f"asked: {NOTHING_ASKED}" in sample.answer for sample in nothing)


def test_planner_and_judge_read_the_same_orders(made: list[Sample]) -> None:
    tasks = {sample.task for sample in made}
    assert tasks == {"planner", "judge"}


def test_equal_recipes_give_equal_samples(made: list[Sample], tmp_path: Path) -> None:
    file = tmp_path / "again.jsonl.gz"
    list(write_readings(file, [Recipe(0, 77, 6, wordings=2)], RULES, 1))
    with gzip.open(file, "rt", encoding="utf-8") as stream:
        again = [Sample.model_validate_json(line) for line in stream]
    assert again == made[: len(again)]


def test_a_broken_list_of_texts_is_named(tmp_path: Path) -> None:
    (tmp_path / "talk.yaml").write_text('- "good morning"\n- 3\n', encoding="utf-8")
    with pytest.raises(ValueError, match=r"talk\.yaml: entry 2: is no text"):
        NoOrders.read(tmp_path)


def test_every_shipped_text_can_be_told_in_a_world() -> None:
    texts, rng, world = NoOrders.shipped(), random.Random(5), shipped_world()
    drawn = [texts.draw(rng, world) for _ in range(400)]
    assert all(one.text and "{asset}" not in one.text for one in drawn)
    assert len({one.kind for one in drawn}) == 10
