"""Other words for missions that were proven: drawn anew, or written one by one.

Proving a mission costs far more than wording it, and what a model has to learn most is wording.

Templates say one thing after another; people tell why, take back, point at what they have just
named and talk of something else. Such words are bound to what they were written for: a group of
the generator, and what is meant there.
"""

import random
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

from pydantic import Field

from pa_console.policy.rulebook import Rulebook
from pa_console.schema.base import StrictModel
from pa_console.schema.document import Document
from pa_training import LANGUAGE
from pa_training.order_generator.orders import canonical_meaning
from pa_training.phrasing.phrase_bank import Split
from pa_training.phrasing.phrasing import phrase
from pa_training.proof.playing import words_findings
from pa_training.samples.near_duplicates import NearDuplicates
from pa_training.samples.planner_samples import Proven, Recipe
from pa_training.situations.situations import Situation

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
    folder = LANGUAGE / "spoken"
    read = [
        Document(part.name, part.read_text(encoding="utf-8")).parse(SpokenWords)
        for part in sorted(folder.iterdir(), key=lambda part: part.name)
        if part.name.endswith(".yaml")
    ]
    return {(one.seed, one.missions): one for one in read}


CONSOLE = "console"
"""The kind of the missions that the console itself would give, in its own fixed words."""
COMBINED = ("compound/", "if-so/", "if-not/", "partly/")
"""Kinds of missions that ask for more than one thing: most of a trained planner's loss is there."""
MORE = 5
"""How many times as many other wordings a combined mission gets."""


@dataclass(frozen=True)
class Rewording:
    """Words the missions of one situation anew; equal states of `rng` give equal words."""

    situation: Situation
    rulebook: Rulebook
    known: NearDuplicates
    rng: random.Random
    split: Split = "train"
    spoken: Words = field(default_factory=dict[str, tuple[str, ...]])

    def all(self, missions: Sequence[Proven], wordings: int) -> Iterator[Proven]:
        """Yield each of `missions` as it is, as people say it where that is known, and reworded.

        At most `wordings` in all beside what people say, with `MORE` times the others for what asks
        for several things.
        """
        for proven in missions:
            yield proven
            yield from self.as_people_say(proven)
            more = MORE if proven.kind.startswith(COMBINED) else 1
            others = (self.reworded(proven) for _ in range((wordings - 1) * more))
            yield from (other for other in others if other is not None)

    def as_people_say(self, proven: Proven) -> Iterator[Proven]:
        """Yield `proven` in every way that people were found to say it.

        What the rules would refuse for its words, or is too like a mission of a test set, is not.
        """
        if proven.order.injected:
            return
        for text in self.spoken.get(canonical_meaning(proven.order, self.situation.world), ()):
            said = self._said(proven, text, SPOKEN)
            if self._refused_for(said) <= self._refused_for(proven) and self._is_unknown(text):
                yield said

    def reworded(self, proven: Proven) -> Proven | None:
        """Return `proven` in other words.

        None where the console words the mission, where the new words are too like a mission of a
        test set, or where the rules that refuse missions for their words alone see another order.
        """
        if proven.kind == CONSOLE:
            return None
        world, picture = self.situation.world, self.situation.picture
        words = phrase(proven.order, world, picture, self.rng, self.split)
        said = self._said(proven, words.text, words.style)
        alike = self._refused_for(said) == self._refused_for(proven)
        return said if alike and self._is_unknown(words.text) else None

    def _said(self, proven: Proven, text: str, style: str) -> Proven:
        case = proven.case.model_copy(update={"command": text})
        return replace(proven, case=case, kind=f"{proven.kind.rpartition('/')[0]}/{style}")

    def _refused_for(self, proven: Proven) -> set[str]:
        """Return the rules that refuse the mission for its words alone."""
        found = words_findings(self.situation.world, proven.case, self.rulebook)
        return {finding.rule_id for finding in found}

    def _is_unknown(self, text: str) -> bool:
        """Return whether no mission of a test set is like `text`; it counts as compared."""
        return all(self.known.keep([text], self.situation.world))
