"""Where an answer could have gone another way, by what the model itself thought of it.

Only the worker process imports this.
"""

from collections.abc import Iterable, Sequence
from heapq import nlargest
from typing import Any, NamedTuple

import numpy as np
from llguidance import LLMatcher
from numpy.typing import NDArray

AT_ONE_PLACE = 32
"""So many of the likeliest tokens are looked at, at each place."""

LONGEST = 8
"""So many tokens of the answer write more than any one token does."""


class Branch(NamedTuple):
    """The answer's first `kept` tokens, then `token`; `chance` is the logarithm of theirs."""

    chance: float
    kept: int
    token: int


def branches(  # noqa: PLR0917
    matcher: LLMatcher,
    tokenizer: Any,
    answer: Sequence[int],
    rows: Iterable[NDArray[np.float32]],
    begun: int,
    count: int,
) -> list[Branch]:
    """Return the `count` likeliest ways to leave `answer`, the likeliest first.

    `rows` are the logits before each of its tokens, shape (n_vocabulary,); `matcher` is at its
    start and is moved along it. Its first `begun` tokens stay, and those that the grammar forces. A
    token that writes what the answer goes on with is no way to leave it.
    """
    found: list[Branch] = []
    chance, forced_to = 0.0, 0
    for position, (token, row) in enumerate(zip(answer, rows, strict=True)):
        if matcher.is_stopped():
            break
        if position >= forced_to:
            forced_to = position + len(matcher.compute_ff_tokens())
        if position >= max(forced_to, begun):
            chances = _chances(matcher, row, token)
            text = tokenizer.decode_bytes(list(answer[position : position + LONGEST]))
            found += [
                Branch(chance + other_chance, position, other)
                for other, other_chance in chances.items()
                if not text.startswith(tokenizer.decode_bytes([other]))
            ]
            chance += chances[token]
        matcher.consume_token(token)
    return nlargest(count, found)


def _chances(matcher: LLMatcher, row: NDArray[np.float32], token: int) -> dict[int, float]:
    """Return the logarithms of the chances of `token` and of the likeliest that are allowed.

    The mask over the whole vocabulary is not computed: inside long texts it is dear.
    """
    likely = np.argpartition(-row, AT_ONE_PLACE)[:AT_ONE_PLACE].tolist()
    allowed = [t for t in likely if t != token and matcher.validate_tokens([t]) == 1]
    values = row[[token, *allowed]].astype(np.float64)
    values -= np.logaddexp.reduce(values)
    return dict(zip([token, *allowed], values.tolist(), strict=True))
