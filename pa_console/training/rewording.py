"""Other words for missions that were proven: what is asked stays, how it is said is drawn anew.

Proving a mission costs far more than wording it, and what a model has to learn most is wording.
"""

import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

from pa_console.policy.rulebook import Rulebook
from pa_console.training.asked import meant
from pa_console.training.near_duplicates import NearDuplicates
from pa_console.training.phrase_bank import Split
from pa_console.training.phrasing import phrase
from pa_console.training.planner_data import Proven
from pa_console.training.playing import words_findings
from pa_console.training.situations import Situation
from pa_console.training.spoken import SPOKEN, Words

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
        for text in self.spoken.get(meant(proven.order, self.situation.world), ()):
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
