"""How sure a model was of words that it wrote: the chance that it gave to its own choices there.

What it wrote of an order with little confidence is what it misread far more often than the rest
(README, Measured): the operator is told so. A confident reading may be wrong as well.
"""

import math
from collections.abc import Sequence

Chance = tuple[int, float]
"""A token that the model chose: how many characters stood before it, the logarithm of its chance.
"""


def confidence(chances: Sequence[Chance], text: str, words: str) -> float | None:
    """Return the chance, 0 to 1, of `words` where they first stand in the answer `text`.

    What the grammar left no choice about is certain. None: the chances, or the words, are not told.
    """
    begin = text.find(words)
    if not chances or not words or begin < 0:
        return None
    end = begin + len(words)
    return round(math.exp(sum(chance for at, chance in chances if begin <= at < end)), 4)
