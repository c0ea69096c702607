"""Generated missions to look at: what was meant and what was said."""

import random
from collections.abc import Iterator

from pa_console.schema.base import StrictModel
from pa_console.training.asked import asked
from pa_console.training.order_sampler import sample_order
from pa_console.training.phrase_bank import Split
from pa_console.training.phrasing import Phrasing, phrase
from pa_console.training.situations import random_situation
from pa_console.training.worlds import random_world

_PER_SITUATION = 5


class Example(StrictModel):
    """One mission in words, with the kind of its order and the canonical words for it."""

    world: str
    kind: str
    meaning: str
    said: Phrasing


def examples(number: int, seed: int, split: Split = "train") -> Iterator[Example]:
    """Yield `number` missions in random situations, five in each; equal seeds give equal ones."""
    rng = random.Random(f"examples/{seed}/{split}")
    while number > 0:
        world = random_world(rng, split)
        situation = random_situation(rng, world)
        picture = situation.picture
        for _ in range(min(number, _PER_SITUATION)):
            order, kind = sample_order(rng, world, picture, situation.digest)
            said = phrase(order, world, picture, rng, split)
            yield Example(
                world=world.name,
                kind=kind,
                meaning=asked(order, world, picture, situation.digest),
                said=said,
            )
        number -= _PER_SITUATION
