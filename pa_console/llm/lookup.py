"""Guesses what a model will write next from what stands in its context already.

Plans repeat names of the prompt. A guess costs little, as it is evaluated together with what is
written anyway, and changes nothing: tokens are taken only where the model would choose the same.
"""

from collections.abc import Sequence

MOST = 5
"""Tokens that are guessed at once."""
LONGEST, SHORTEST = 3, 2
"""So many tokens before the guess have to be the same, the longer the better."""


def guess(context: Sequence[int], most: int = MOST) -> list[int]:
    """Return what followed the last time that `context` ended as it ends now; maybe nothing.

    At most `most` tokens are returned.
    """
    for length in range(min(LONGEST, len(context) - 1), SHORTEST - 1, -1):
        end = list(context[-length:])
        for start in range(len(context) - length - 1, -1, -1):
            if context[start] == end[0] and list(context[start : start + length]) == end:
                return list(context[start + length : start + length + most])
    return []
