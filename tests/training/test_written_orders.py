"""Orders of writers: every one can be read, and becomes samples of its reading alone."""

from collections.abc import Iterator

import pytest

from pa_console.language.canonical.clauses import ASKED
from pa_console.language.canonical.reading import read_asked
from pa_training import LANGUAGE
from pa_training.phrasing.no_orders import NOTHING_ASKED
from pa_training.samples.sample import Sample
from pa_training.samples.written_orders import (
    Writer,
    asked_as_seen,
    drawn_situation,
    read_writers,
    written_samples,
)
from pa_training.situations.worlds import generated_numbers, shipped_missions

WRITERS = {
    **read_writers(LANGUAGE / "written"),
    **read_writers(LANGUAGE / "development"),
}


def readings(writer: Writer) -> Iterator[tuple[str, str, set[str]]]:
    """Yield text, reading and the names of the site of every order."""
    forbidden = generated_numbers(shipped_missions())
    for each in writer.situations:
        there = drawn_situation(each.seed, each.number, each.split, forbidden)
        world = there.world
        names = {*world.assets, *world.frames, *world.zones}
        for order in each.orders:
            yield order.text, asked_as_seen(order.meaning, world, there.digest), names


@pytest.mark.parametrize("name", WRITERS)
def test_every_meaning_is_of_the_language(name: str) -> None:
    for text, asked, names in readings(WRITERS[name]):
        reading = read_asked(asked)
        assert reading is not None, text
        assert reading.readable or asked == f"{ASKED}{NOTHING_ASKED}", (text, asked)
        assert {*reading.excluded} <= names, (text, asked)


def test_no_writer_who_is_kept_aside_is_learnt() -> None:
    learnt = {file.name for file in (LANGUAGE / "written").glob("*.yaml")}
    aside = {file.name for file in (LANGUAGE / "development").glob("*.yaml")}
    assert learnt
    assert aside
    assert not learnt & aside
    texts = [{text for text, _, _ in readings(writer)} for writer in WRITERS.values()]
    assert sum(map(len, texts)) == len(set[str]().union(*texts))


def test_planner_and_judge_learn_the_same_reading() -> None:
    name, writer = next(iter(WRITERS.items()))
    samples = list(written_samples(name, writer))
    assert len(samples) > 100
    for planner, judge in zip(samples[::2], samples[1::2], strict=True):
        assert _read(planner).startswith(_read(judge).removesuffix("; planned"))
        assert (planner.goes_on, judge.goes_on) == (True, True)


def _read(sample: Sample) -> str:
    return sample.answer.partition('": "')[2]
