"""Where an answer could have gone another way, by what the model itself thought of it.

Only the worker process imports this.
"""

from collections.abc import Iterable, Sequence
from heapq import nlargest
from typing import Any, NamedTuple

import numpy as np
from llguidance import LLMatcher
from numpy.typing import NDArray

from pa_console.llm.token_choice import allowed_only

AT_ONE_PLACE = 8
"""So many tokens are looked at, the answer's own among them, at each place."""

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
            forced = matcher.compute_ff_tokens()
            forced_to = position + len(forced)
        if position >= forced_to:
            allowed = allowed_only(matcher, row)
            chances = allowed - _log_sum(allowed)
            if position >= begun:
                others = np.argpartition(-chances, AT_ONE_PLACE)[:AT_ONE_PLACE].tolist()
                text = tokenizer.decode_bytes(list(answer[position : position + LONGEST]))
                found += [
                    Branch(chance + float(chances[other]), position, other)
                    for other in others
                    if np.isfinite(chances[other])
                    and not text.startswith(tokenizer.decode_bytes([other]))
                ]
            chance += float(chances[token])
        matcher.consume_token(token)
    return nlargest(count, found)


def _log_sum(values: NDArray[np.float32]) -> float:
    """Return the logarithm of the sum of the exponentials of `values`."""
    top = float(values.max())
    return top + float(np.log(np.exp(values - top).sum()))
