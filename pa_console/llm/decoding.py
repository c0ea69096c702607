"""Greedy decoding under a grammar, with forced tokens evaluated in batches.

Only the worker process imports this. The most likely token is tried first; the mask over the whole
vocabulary is computed only when the grammar refuses it.
"""

import codecs
from collections.abc import Callable, Sequence
from time import perf_counter
from typing import Any

import numpy as np
from llguidance import LLMatcher
from llguidance.llamacpp import lltokenizer_from_vocab
from numpy.typing import NDArray

from pa_console.llm.candidates import Candidates
from pa_console.llm.lookup import guess
from pa_console.llm.protocol import Finish
from pa_console.llm.runtime import Runtime
from pa_console.llm.shared_context import InterruptedEvaluationError
from pa_console.llm.token_choice import allowed_only, forced_tokens, readable
from pa_console.schema.finding import Usage


class Decoder:
    """Writes answers with one model; temperature 0, so the same prompt gives the same answer."""

    def __init__(self, runtime: Runtime) -> None:
        self._runtime = runtime
        self._ends = frozenset(runtime.end_tokens)
        vocabulary: Any = runtime.vocabulary
        self._tokenizer = lltokenizer_from_vocab(vocabulary, eos_token=sorted(self._ends))
        self._candidates: Candidates | None = None
        self.written: tuple[int, ...] = ()
        """The tokens of the last answer."""

    def answer(
        self,
        sequence: int,
        prompt: Sequence[int],
        grammar: str,
        max_tokens: int,
        on_text: Callable[[str], None],
    ) -> tuple[Finish, Usage]:
        """Write an answer to `prompt` that `grammar` (lark) accepts, giving text as it comes.

        Returns why it ended and what it cost. Raises ValueError when the grammar is not valid or
        prompt and answer do not fit in the context.
        """
        self._fits(prompt, max_tokens)
        matcher = LLMatcher(self._tokenizer, grammar, log_level=0)
        if matcher.is_error():
            raise ValueError(f"the grammar is not valid: {matcher.get_error()}")
        run = _Run(self._runtime, self._tokenizer, matcher, self._ends, on_text)
        context = list(prompt)
        finish = run.write(sequence, context, max_tokens)
        self.written = tuple(context[len(prompt) :])
        return finish, run.usage(len(prompt))

    def several(
        self, sequence: int, prompt: Sequence[int], grammar: str, max_tokens: int, count: int
    ) -> tuple[list[str], Finish, Usage]:
        """Write `count` answers to `prompt` in one batch; returns those that are complete.

        Raises ValueError as `answer` does.
        """
        self._fits(prompt, max_tokens)
        if self._candidates is None or self._candidates.width < count:
            if self._candidates is not None:
                self._candidates.close()
            shared = self._runtime.shared_context(count, max_tokens)
            self._candidates = Candidates(self._runtime, shared, self._tokenizer, self._ends)
        return self._candidates.answers(sequence, prompt, grammar, max_tokens, count)

    def _fits(self, prompt: Sequence[int], max_tokens: int) -> None:
        room = self._runtime.n_ctx - max_tokens
        if len(prompt) > room:
            raise ValueError(
                f"the prompt has {len(prompt)} tokens and at most {room} fit beside an answer of "
                f"{max_tokens} in the model's context of {self._runtime.n_ctx}: shorten the mission"
            )


class _Run:
    """One answer being written."""

    def __init__(
        self,
        runtime: Runtime,
        tokenizer: Any,
        matcher: LLMatcher,
        ends: frozenset[int],
        on_text: Callable[[str], None],
    ) -> None:
        self._runtime, self._tokenizer, self._matcher = runtime, tokenizer, matcher
        self._ends, self._on_text = ends, on_text
        self._utf8 = codecs.getincrementaldecoder("utf-8")("replace")
        self._started = perf_counter()
        self._first_token_s = 0.0
        self._cached = self._written = self._sampled = self._guessed = 0

    def write(self, sequence: int, context: list[int], max_tokens: int) -> Finish:
        """Write to the end of `context`, the prompt.

        Every batch holds what is due and a guess at what comes after it.
        """
        try:
            pending = self._take(forced_tokens(self._matcher), context, max_tokens)
            row, self._cached = self._runtime.begin(sequence, context)
            self._first_token_s = perf_counter() - self._started
            pending = self._take(self._next(row), context, max_tokens)
            while not self._matcher.is_stopped() and self._written < max_tokens:
                evaluated = len(context) - len(pending)
                guessed = self._guess(context)
                rows = self._runtime.extend(
                    sequence, evaluated, [*pending, *guessed], 1 + len(guessed)
                )
                pending, right = self._follow(rows, guessed, context, max_tokens)
                self._runtime.keep(sequence, len(context) - len(pending), right < len(guessed))
        except InterruptedEvaluationError:
            return "cancelled"
        return "stop" if self._matcher.is_stopped() else "length"

    def _guess(self, context: Sequence[int]) -> list[int]:
        """Return tokens that may come next and that the grammar would allow."""
        guessed = guess(context)
        return guessed[: self._matcher.validate_tokens(guessed)] if guessed else []

    def _follow(
        self,
        rows: NDArray[np.float32],
        guessed: Sequence[int],
        context: list[int],
        max_tokens: int,
    ) -> tuple[list[int], int]:
        """Take tokens while they are those that were guessed.

        `rows` are the logits before and after every guessed token. Returns the tokens that were
        taken but not evaluated, and how many guesses were right.
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
        """Add `tokens`, as far as there is room, to the answer."""
        taken = tokens[: max_tokens - self._written]
        self._written += len(taken)
        context += taken
        self._give(taken)
        return taken

    def usage(self, prompt_tokens: int) -> Usage:
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
        """Return the next tokens: those that are forced, or one chosen and those it forces."""
        tokens = forced_tokens(self._matcher)
        if tokens or self._matcher.is_stopped():
            return tokens
        token = int(np.argmax(logits))
        if self._matcher.try_consume_tokens([token]) != 1:
            token = int(np.argmax(allowed_only(self._matcher, logits)))
            self._matcher.consume_token(token)
        self._sampled += 1
        return [token, *forced_tokens(self._matcher)]

    def _give(self, tokens: Sequence[int]) -> None:
        text = self._utf8.decode(readable(self._tokenizer, tokens, self._ends))
        if text:
            self._on_text(text)
