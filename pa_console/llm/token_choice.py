"""Which tokens a grammar leaves: the forced ones, the allowed ones, and what tokens write."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from llguidance import LLMatcher
from numpy.typing import NDArray


def forced_tokens(matcher: LLMatcher) -> list[int]:
    """Take and return the tokens that the grammar leaves no choice about."""
    tokens = matcher.compute_ff_tokens()
    if tokens:
        matcher.consume_tokens(tokens)
    return tokens


def likeliest(matcher: LLMatcher, logits: NDArray[np.float32]) -> int:
    """Take and return the likeliest token; the mask is computed only when that is refused."""
    token = int(np.argmax(logits))
    if matcher.try_consume_tokens([token]) != 1:
        token = int(np.argmax(allowed_only(matcher, logits)))
        matcher.consume_token(token)
    return token


def log_chance(logits: NDArray[np.float32], token: int) -> float:
    """Return the logarithm of the chance that `logits` give to `token`, grammar or not."""
    highest = logits.max()
    total = np.exp(logits - highest).sum()
    return float(logits[token] - highest - np.log(total))


def allowed_only(matcher: LLMatcher, logits: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return `logits` with minus infinity for what the grammar refuses; ValueError for all."""
    mask = np.frombuffer(matcher.compute_bitmask(), dtype=np.uint8)
    allowed = np.unpackbits(mask, bitorder="little")[: logits.size].astype(bool)
    if not allowed.any():
        raise ValueError(f"the grammar is at a dead end: {matcher.get_error()}")
    return np.where(allowed, logits, np.float32(-np.inf))


def readable(tokenizer: Any, tokens: Sequence[int], ends: frozenset[int]) -> bytes:
    """Return what `tokens` write, without end marks."""
    return tokenizer.decode_bytes([token for token in tokens if token not in ends])
