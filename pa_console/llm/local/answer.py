"""An answer being written under a grammar; forced and guessed tokens are evaluated in batches.

Plans repeat names from the prompt, so tokens can be guessed. A guess costs little, because it is
evaluated in one batch with the next tokens. It does not change the answer, because a guessed token
is accepted only if the model would choose it. The most likely token is tried first; the mask over
the whole vocabulary is computed only if the grammar refuses that token. Only the worker process
imports this module.
"""

import codecs
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import accumulate, takewhile
from time import perf_counter
from typing import Any

import numpy as np
from llguidance import LLMatcher
from numpy.typing import NDArray

from pa_console.llm.backend import Chance, Finish
from pa_console.llm.local.runtime import InterruptedEvaluationError, Runtime
from pa_console.schema.finding import Usage

MOST = 5
"""The largest number of tokens that are guessed at once."""
LONGEST, SHORTEST = 3, 2
"""The greatest and least number of matching tokens on which a guess is based; more are better."""

LOOSE = 3
"""The number of tokens at an answer's end that are written again when another answer continues it.
"""


def lookup_tokens(context: Sequence[int], most: int = MOST) -> list[int]:
    """Return the tokens that followed the last earlier occurrence of the end of `context`.

    At most `most` tokens are returned, or none if there is no earlier occurrence.
    """
    for length in range(min(LONGEST, len(context) - 1), SHORTEST - 1, -1):
        end = list(context[-length:])
        for start in range(len(context) - length - 1, -1, -1):
            if context[start] == end[0] and list(context[start : start + length]) == end:
                return list(context[start + length : start + length + most])
    return []


def forced_tokens(matcher: LLMatcher) -> list[int]:
    """Consume and return the tokens that the grammar forces."""
    tokens = matcher.compute_ff_tokens()
    if tokens:
        matcher.consume_tokens(tokens)
    return tokens


def likeliest(matcher: LLMatcher, logits: NDArray[np.float32]) -> int:
    """Consume and return the likeliest allowed token; compute the mask only if necessary."""
    token = int(np.argmax(logits))
    if matcher.try_consume_tokens([token]) != 1:
        token = int(np.argmax(allowed_only(matcher, logits)))
        matcher.consume_token(token)
    return token


def log_chance(logits: NDArray[np.float32], token: int) -> float:
    """Return the log probability of `token` according to `logits`, regardless of the grammar."""
    highest = logits.max()
    total = np.exp(logits - highest).sum()
    return float(logits[token] - highest - np.log(total))


def allowed_only(matcher: LLMatcher, logits: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return `logits` with minus infinity for tokens that the grammar refuses.

    Raises ValueError if it refuses all tokens.
    """
    mask = np.frombuffer(matcher.compute_bitmask(), dtype=np.uint8)
    allowed = np.unpackbits(mask, bitorder="little")[: logits.size].astype(bool)
    if not allowed.any():
        raise ValueError(f"the grammar is at a dead end: {matcher.get_error()}")
    return np.where(allowed, logits, np.float32(-np.inf))


def readable(tokenizer: Any, tokens: Sequence[int], ends: frozenset[int]) -> bytes:
    """Return the text of `tokens` as bytes, without end marks."""
    return tokenizer.decode_bytes([token for token in tokens if token not in ends])


@dataclass(frozen=True)
class FinishedAnswer:
    """A complete answer; `evaluated` is how many tokens of prompt and answer are in the cache."""

    prompt: Sequence[int]
    tokens: Sequence[int]
    text: str
    evaluated: int

    def is_of(self, prompt: Sequence[int], text: str) -> bool:
        """Return whether this is the answer `text` to `prompt`."""
        return self.prompt == prompt and self.text == text

    def beginning(self, ends: frozenset[int]) -> list[int]:
        """Return the tokens without the last ones, because they may merge with a continuation."""
        written = [token for token in self.tokens if token not in ends]
        return written[:-LOOSE]

    def within(self, text: str, tokenizer: Any) -> int:
        """Return the number of tokens that lie within `text`, the answer's beginning."""
        room = len(text.encode())
        ends = accumulate(len(tokenizer.decode_bytes([token])) for token in self.tokens)
        return sum(1 for _ in takewhile(lambda end: end <= room, ends))


class AnswerRun:
    """One answer being written."""

    def __init__(  # noqa: PLR0917
        self,
        runtime: Runtime,
        tokenizer: Any,
        matcher: LLMatcher,
        ends: frozenset[int],
        on_text: Callable[[str], None],
        hint: Sequence[int],
    ) -> None:
        self._runtime, self._tokenizer, self._matcher = runtime, tokenizer, matcher
        self._ends, self._on_text, self._hint = ends, on_text, hint
        self._utf8 = codecs.getincrementaldecoder("utf-8")("replace")
        self._started = perf_counter()
        self._first_token_s = 0.0
        self._cached = self._written = self._sampled = self._guessed = 0
        self.text = ""
        self.chances: list[Chance] = []
        self.done = 0
        """The number of evaluated tokens of prompt and answer."""

    def write(self, sequence: int, context: list[int], max_tokens: int) -> Finish:
        """Write the answer to the end of `context`, the prompt."""
        try:
            self._take(forced_tokens(self._matcher), context, max_tokens)
            row, self._cached = self._runtime.begin(sequence, context)
            self._first_token_s = perf_counter() - self._started
            pending = self._take(self._next(row), context, max_tokens)
            return self._rest(sequence, context, pending, max_tokens)
        except InterruptedEvaluationError:
            return "cancelled"

    def go_on(
        self, sequence: int, context: list[int], last: FinishedAnswer, max_tokens: int
    ) -> Finish:
        """Write an answer that begins like `last` to the end of `context`, the prompt.

        If the grammar refuses the beginning of `last`, the whole answer is written anew.
        """
        begun = last.beginning(self._ends)
        if not begun or self._matcher.try_consume_tokens(begun) != len(begun):
            self._matcher.reset()
            return self.write(sequence, context, max_tokens)
        prompt_tokens = len(context)
        self._take(begun, context, max_tokens)
        evaluated = min(last.evaluated, len(context) - 1)
        self._cached = min(evaluated, prompt_tokens)
        self._runtime.keep(sequence, evaluated, trim=True)
        self._take(forced_tokens(self._matcher), context, max_tokens)
        try:
            return self._rest(sequence, context, context[evaluated:], max_tokens)
        except InterruptedEvaluationError:
            return "cancelled"

    def _rest(
        self, sequence: int, context: list[int], pending: list[int], max_tokens: int
    ) -> Finish:
        """Write until the grammar ends; the tokens `pending` are accepted but not yet evaluated.

        Every batch has the pending tokens and a guess of the tokens that follow.
        """
        while not self._matcher.is_stopped() and self._written < max_tokens:
            evaluated = len(context) - len(pending)
            guessed = self._guess(context)
            rows = self._runtime.extend(sequence, evaluated, [*pending, *guessed], 1 + len(guessed))
            pending, right = self._follow(rows, guessed, context, max_tokens)
            self._runtime.keep(sequence, len(context) - len(pending), right < len(guessed))
        self.done = len(context) - len(pending)
        return "stop" if self._matcher.is_stopped() else "length"

    def _guess(self, context: Sequence[int]) -> list[int]:
        """Return tokens that may come next and that the grammar allows."""
        guessed = lookup_tokens([*self._hint, *context])
        return guessed[: self._matcher.validate_tokens(guessed)] if guessed else []

    def _follow(
        self,
        rows: NDArray[np.float32],
        guessed: Sequence[int],
        context: list[int],
        max_tokens: int,
    ) -> tuple[list[int], int]:
        """Accept the model's tokens while they match the guess, and the first that do not match.

        `rows` are the logits before and after each guessed token. Returns the accepted tokens that
        were not evaluated, and the number of correct guesses.
        """
        right = 0
        while True:
            chosen = self._sampled
            tokens = self._take(self._next(rows[right]), context, max_tokens)
            same = 0
            while same < len(tokens) and guessed[right : right + 1] == [tokens[same]]:
                right, same = right + 1, same + 1
            self._guessed += self._sampled - chosen if same else 0
            over = self._matcher.is_stopped() or self._written >= max_tokens
            if over or same < len(tokens):
                return tokens[same:], right

    def _take(self, tokens: list[int], context: list[int], max_tokens: int) -> list[int]:
        """Add as many of `tokens` to the answer as fit, and return them."""
        taken = tokens[: max_tokens - self._written]
        self._written += len(taken)
        context += taken
        self._give(taken)
        return taken

    def usage(self, prompt_tokens: int) -> Usage:
        """Return the cost of the answer to a prompt of `prompt_tokens`."""
        return Usage(
            prompt_tokens=prompt_tokens,
            cached_tokens=self._cached,
            completion_tokens=self._written,
            sampled_tokens=self._sampled,
            guessed_tokens=self._guessed,
            first_token_s=self._first_token_s,
            seconds=perf_counter() - self._started,
        )

    def _next(self, logits: NDArray[np.float32]) -> list[int]:
        """Return the next tokens: forced tokens, or a chosen token and the tokens forced by it."""
        tokens = forced_tokens(self._matcher)
        if tokens or self._matcher.is_stopped():
            return tokens
        token = likeliest(self._matcher, logits)
        self._sampled += 1
        self.chances.append((len(self.text), round(log_chance(logits, token), 4)))
        return [token, *forced_tokens(self._matcher)]

    def _give(self, tokens: Sequence[int]) -> None:
        text = self._utf8.decode(readable(self._tokenizer, tokens, self._ends))
        if text:
            self.text += text
            self._on_text(text)
