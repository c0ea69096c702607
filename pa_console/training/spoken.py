"""Whole orders as people say them, written one by one for proven missions of one seed.

Templates say one thing after another; people tell why, take back, point at what they have just
named and talk of something else. Such words are bound to what they were written for: a group of
the generator, and what is meant there.
"""

from collections.abc import Mapping, Sequence
from functools import cache

from pydantic import Field

from pa_console.resources import training_data
from pa_console.schema.base import StrictModel
from pa_console.schema.document import Document
from pa_console.training.planner_data import Recipe

SPOKEN = "spoken"
"""The style of a mission that is worded so."""

Words = Mapping[str, Sequence[str]]
"""What is meant, in canonical words (`asked.meant`) -> how people say it."""


class SpokenWords(StrictModel):
    """One file of words: they fit the groups of `seed` that have `missions` missions each."""

    seed: int
    missions: int
    words: dict[int, dict[str, tuple[str, ...]]] = Field(description="group -> meant -> said")


def spoken_words(recipe: Recipe) -> Words:
    """Return the words written for the group that `recipe` makes, none for most.

    What the generator draws for a seed may change with its code; words for what it no longer draws
    are not used, and never for something else. Raises DocumentError for a broken file.
    """
    found = _files().get((recipe.seed, recipe.missions)) if recipe.split == "train" else None
    return {} if found is None else found.words.get(recipe.number, {})


@cache
def _files() -> Mapping[tuple[int, int], SpokenWords]:
    folder = training_data("language") / "spoken"
    read = [
        Document(part.name, part.read_text(encoding="utf-8")).parse(SpokenWords)
        for part in sorted(folder.iterdir(), key=lambda part: part.name)
        if part.name.endswith(".yaml")
    ]
    return {(one.seed, one.missions): one for one in read}
