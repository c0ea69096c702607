"""Orders that writers wrote for situations they were shown, each with its meaning.

A writer sees a site, and no order or text of anybody else. The meaning is in the canonical words
of `language/canonical/clauses.py`; a second reader who saw only the orders wrote it again, and
where the two differ the order is left out. `language/written` and `language/spoken` are learnt,
`language/development` is kept aside: nothing is fitted on it. `language/sealed` is for the last
evaluation alone.
"""

import random
from collections.abc import Collection
from functools import lru_cache
from typing import Literal

from pydantic import Field

from pa_console.schema.base import StrictModel
from pa_console.schema.document import Document
from pa_training import LANGUAGE
from pa_training.situations.situations import Situation, random_situation
from pa_training.situations.worlds import Numbers, Split, random_world

Source = Literal["written", "spoken", "development", "sealed"]
"""The folders of `language` that hold orders."""


class WrittenOrder(StrictModel):
    """One order in a writer's words, and its meaning in canonical words."""

    text: str
    meaning: str


class WrittenDialogue(StrictModel):
    """Orders that follow each other, each given after the one before was carried out."""

    turns: tuple[WrittenOrder, ...] = Field(min_length=1)


class WrittenSituation(StrictModel):
    """The draw of a situation, and what was written for it."""

    seed: int
    number: int
    split: Split
    history: bool = Field(default=True, description="whether something was ordered before")
    clock: str = Field(default="", description="the time of day that the writer saw, HH:MM")
    orders: tuple[WrittenOrder | WrittenDialogue, ...]

    @property
    def first_orders(self) -> tuple[WrittenOrder, ...]:
        """The orders that stand by themselves, and the first turn of each dialogue."""
        return tuple(
            order.turns[0] if isinstance(order, WrittenDialogue) else order for order in self.orders
        )


class Writer(StrictModel):
    """One writer's file."""

    writer: str = Field(description="who it was: the persona, in a sentence")
    situations: tuple[WrittenSituation, ...]


class SpokenOrders(StrictModel):
    """A file of meanings in the situations of one seed, each in the words of several people."""

    seed: int
    words: dict[int, dict[str, tuple[str, ...]]] = Field(description="number -> meaning -> texts")

    def as_writer(self) -> Writer:
        """Return the same as the file of one writer."""
        situations = (
            WrittenSituation(
                seed=self.seed,
                number=number,
                split="train",
                orders=tuple(
                    WrittenOrder(text=text, meaning=meaning)
                    for meaning, texts in meanings.items()
                    for text in texts
                ),
            )
            for number, meanings in self.words.items()
        )
        return Writer(writer=f"people, seed {self.seed}", situations=tuple(situations))


def writer_names(source: Source) -> list[str]:
    """Return the names of the writers of `source`, in order."""
    return sorted(file.stem for file in (LANGUAGE / source).glob("*.yaml"))


@lru_cache(maxsize=4)
def read_writer(source: Source, name: str) -> Writer:
    """Return one writer of `source`; raises DocumentError or OSError."""
    document = Document.read(LANGUAGE / source / f"{name}.yaml")
    return (
        document.parse(SpokenOrders).as_writer() if source == "spoken" else document.parse(Writer)
    )


def read_writers(source: Source) -> dict[str, Writer]:
    """Return all writers of `source` by name; raises DocumentError or OSError."""
    return {name: read_writer(source, name) for name in writer_names(source)}


def drawn_situation(written: WrittenSituation, forbidden: Collection[Numbers]) -> Situation:
    """Return the situation that a writer was shown."""
    rng = random.Random(f"{written.seed}/{written.split}/{written.number}")
    world = random_world(rng, written.split, frozenset(forbidden))
    return random_situation(rng, world, history=written.history)
