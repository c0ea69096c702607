"""Where an answer could have gone another way, by what the model itself thought of it.

Only the worker process imports this.
"""

from collections.abc import Iterable, Sequence
from heapq import heappop, heappush
from math import inf
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
    """The likeliest ones so far, the least likely of them first."""
    chance, forced_to = 0.0, 0
    for position, (token, row) in enumerate(zip(answer, rows, strict=True)):
        if matcher.is_stopped():
            break
        if position >= forced_to:
            forced_to = position + len(matcher.compute_ff_tokens())
        if position >= max(forced_to, begun):
            least = found[0].chance - chance if len(found) == count else -inf
            chances = _chances(matcher, row, token, least)
            text = tokenizer.decode_bytes(list(answer[position : position + LONGEST]))
            for other, other_chance in chances.items():
                if not text.startswith(tokenizer.decode_bytes([other])):
                    heappush(found, Branch(chance + other_chance, position, other))
                    if len(found) > count:
                        heappop(found)
            chance += chances[token]
        matcher.consume_token(token)
    return sorted(found, reverse=True)


def _chances(
    matcher: LLMatcher, row: NDArray[np.float32], token: int, least: float
) -> dict[int, float]:
    """Return the logarithms of the chances of `token` and of the likeliest that are allowed.

    Those that cannot be likelier than `least` are left out, and not put to the grammar: inside long
    texts that is dear, as the mask over the whole vocabulary would be.
    """
    likely = np.argpartition(-row, AT_ONE_PLACE)[:AT_ONE_PLACE]
    at_most = row[likely] - np.logaddexp(row[likely], row[token])
    wanted = likely[at_most >= least].tolist()
    allowed = [t for t in wanted if t != token and matcher.validate_tokens([t]) == 1]
    values = row[[token, *allowed]].astype(np.float64)
    values -= np.logaddexp.reduce(values)
    return dict(zip([token, *allowed], values.tolist(), strict=True))
