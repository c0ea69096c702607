"""Other words for missions that were proven: what is asked stays, how it is said is drawn anew.

Proving a mission costs far more than wording it, and what a model has to learn most is wording.
"""

import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from pa_console.policy.rulebook import Rulebook
from pa_console.training.near_duplicates import NearDuplicates
from pa_console.training.phrase_bank import Split
from pa_console.training.phrasing import phrase
from pa_console.training.planner_data import Proven
from pa_console.training.playing import words_findings
from pa_console.training.situations import Situation

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

    def all(self, missions: Sequence[Proven], wordings: int) -> Iterator[Proven]:
        """Yield each of `missions` as it is, and then in other words.

        At most `wordings` in all, with `MORE` times the others for what asks for several things.
        """
        for proven in missions:
            yield proven
            more = MORE if proven.kind.startswith(COMBINED) else 1
            others = (self.reworded(proven) for _ in range((wordings - 1) * more))
            yield from (other for other in others if other is not None)

    def reworded(self, proven: Proven) -> Proven | None:
        """Return `proven` in other words.

        None where the console words the mission, where the new words are too like a mission of a
        test set, or where the rules that refuse missions for their words alone see another order.
        """
        if proven.kind == CONSOLE:
            return None
        world, picture = self.situation.world, self.situation.picture
        words = phrase(proven.order, world, picture, self.rng, self.split)
        case = proven.case.model_copy(update={"command": words.text})
        before, after = (words_findings(world, each, self.rulebook) for each in (proven.case, case))
        if {f.rule_id for f in before} != {f.rule_id for f in after}:
            return None
        if not all(self.known.keep([words.text], world)):
            return None
        kind = f"{proven.kind.rpartition('/')[0]}/{words.style}"
        return replace(proven, case=case, kind=kind)
