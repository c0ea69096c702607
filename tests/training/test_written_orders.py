"""Orders of writers: every one can be read, and becomes samples of its reading alone."""

import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from itertools import islice

import pytest

from pa_console.language.canonical.clauses import ASKED
from pa_console.language.canonical.reading import read_asked
from pa_training.orders.meaning import NOTHING_ASKED, asked_as_seen, meaning_now
from pa_training.orders.written import (
    Source,
    Writer,
    WrittenDialogue,
    drawn_situation,
    read_writer,
    read_writers,
    writer_names,
)
from pa_training.samples.groups import recipes, situation_of
from pa_training.samples.readings import written_readings
from pa_training.samples.sample import Sample
from pa_training.situations.worlds import generated_numbers, shipped_missions

SOURCES: tuple[Source, ...] = ("written", "development", "sealed")
WRITERS = [(source, name) for source in SOURCES for name in writer_names(source)]
SPOKEN: Source = "spoken"


def readings(writer: Writer) -> Iterator[tuple[str, str, set[str]]]:
    """Yield text, reading and the names of the site of every order for a single plan."""
    forbidden = generated_numbers(shipped_missions())
    for each in writer.situations:
        there = drawn_situation(each, forbidden)
        world = there.world
        names = {*world.assets, *world.frames, *world.zones}
        for order in each.first_orders:
            if meaning := meaning_now(order.meaning):
                with suppress(ValueError):  # a condition about a place where sensors show nothing
                    yield order.text, asked_as_seen(meaning, world, there.digest), names


@pytest.mark.parametrize(("source", "name"), [*WRITERS, (SPOKEN, writer_names(SPOKEN)[0])])
def test_every_meaning_is_of_the_language(source: Source, name: str) -> None:
    for text, asked, names in readings(read_writer(source, name)):
        reading = read_asked(asked)
        assert reading is not None, text
        assert reading.readable or asked == f"{ASKED}{NOTHING_ASKED}", (text, asked)
        assert {*reading.excluded} <= names, (text, asked)


def test_no_writer_who_is_kept_aside_is_learnt() -> None:
    writers = {source: read_writers(source) for source in SOURCES}
    texts = {source: {*map(_words, _texts(found.values()))} for source, found in writers.items()}
    assert all(texts.values())
    for aside in SOURCES[1:]:
        assert not writers["written"].keys() & writers[aside].keys()
        common = texts["written"] & texts[aside]
        assert len(common) <= SAID_BY_ANYBODY * len(texts[aside]), common


SAID_BY_ANYBODY = 0.01
"""The share of texts that are so short that two writers may have the same: *hold everything*."""


def _texts(writers: Iterable[Writer]) -> Iterator[str]:
    for writer in writers:
        for situation in writer.situations:
            for order in situation.orders:
                turns = order.turns if isinstance(order, WrittenDialogue) else (order,)
                yield from (turn.text for turn in turns)


def _words(text: str) -> str:
    return " ".join(re.findall(r"\w+", text.lower()))


@pytest.mark.parametrize(
    ("meaning", "now"),
    [
        ("Drone_T01 to EastGate", "Drone_T01 to EastGate"),
        ("forbid any to EastGate", "nothing"),
        ("not now", "nothing"),
        ("question", ""),
        ("unclear: gate", ""),
        ("at 14:30: Drone_T01 home", ""),
        ("Drone_T01 to EastGate; then Drone_T01 home", ""),
        ("Drone_T01 patrol EastGate, WestGate", ""),
        ("Drone_T01 to EastGate for 20 min", ""),
        ("instead: Drone_T01 home", ""),
    ],
)
def test_a_single_plan_is_read_from_what_it_can_express(meaning: str, now: str) -> None:
    assert meaning_now(meaning) == now


def made(count: int) -> list[Sample]:
    """Return the samples of the first situations of the writers kept aside."""
    forbidden = generated_numbers(shipped_missions())
    some = islice(recipes("development"), count)
    return [
        sample
        for recipe in some
        for sample in written_readings(recipe.name, recipe.written, situation_of(recipe, forbidden))
    ]


def test_planner_and_judge_learn_the_same_reading() -> None:
    samples = made(4)
    assert len(samples) > 100
    for planner, judge in zip(samples[::2], samples[1::2], strict=True):
        assert _read(planner).startswith(_read(judge).removesuffix("; planned"))
        assert (planner.goes_on, judge.goes_on) == (True, True)
    nothing = [sample for sample in samples if sample.kind.startswith("nothing/")]
    assert nothing
    assert all(f"asked: {NOTHING_ASKED}" in sample.answer for sample in nothing)


def _read(sample: Sample) -> str:
    return sample.answer.partition('": "')[2]


def test_a_later_turn_is_read_after_the_commands_of_the_turn_before() -> None:
    found = 0
    for sample in made(12):
        before, _, mission = sample.rest.rpartition("Mission: ")
        assert mission
        if before:
            found += 1
            assert re.fullmatch(r"Before: (?:\w+ [a-z_]+(?: \w+)?(?: from \w+)?;? ?)+\n", before)
    assert found
