"""Several answers to one prompt, decoded in one batch that shares the evaluated prompt.

Only the worker process imports this. A context of its own, cleared before every use, holds the
copies, so the caches of the roles stay as they are and equal requests give equal answers.
"""

import codecs
from collections.abc import Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

import numpy as np
from llguidance import LLMatcher
from numpy.typing import NDArray

from pa_console.llm.protocol import Finish
from pa_console.llm.runtime import Runtime
from pa_console.llm.shared_context import InterruptedEvaluationError, SharedContext
from pa_console.llm.token_choice import allowed_only, forced_tokens, readable
from pa_console.schema.finding import Usage

TEMPERATURE = 0.8


@dataclass
class _Answer:
    """One answer being written; `open` until the grammar ends it or it is too long."""

    matcher: LLMatcher
    logits: NDArray[np.float32]
    random: np.random.Generator
    tokens: list[int] = field(default_factory=list[int])
    pending: list[int] = field(default_factory=list[int])
    sampled: int = 0
    open: bool = True


class Candidates:
    """Samples answers at TEMPERATURE; each is what the model might have said instead."""

    def __init__(
        self, runtime: Runtime, shared: SharedContext, tokenizer: Any, ends: frozenset[int]
    ) -> None:
        """`shared` is asked to hold the copies of a sequence of `runtime`."""
        self._runtime, self._shared = runtime, shared
        self._tokenizer, self._ends = tokenizer, ends

    @property
    def width(self) -> int:
        """So many answers fit."""
        return self._shared.width

    def close(self) -> None:
        """Give the memory of the copies back."""
        self._shared.close()

    def answers(  # noqa: PLR0917
        self,
        sequence: int,
        prompt: Sequence[int],
        grammar: str,
        max_tokens: int,
        count: int,
        begun: Sequence[int] = (),
    ) -> tuple[list[str], Finish, Usage]:
        """Write `count` answers to `prompt` that begin with `begun`; incomplete ones are left out.

        Raises ValueError when the grammar is not valid, refuses `begun`, or there is no room.
        """
        started = perf_counter()
        texts: list[str] = []
        answers: list[_Answer] = []
        cached, first = 0, 0.0
        finish: Finish = "stop"
        try:
            logits, evaluated = self._runtime.begin(sequence, [*prompt, *begun])
            cached = min(evaluated, len(prompt))
            first = perf_counter() - started
            answers = [self._begun(grammar, begun, logits, number) for number in range(count)]
            self._shared.adopt(self._runtime.state(sequence), count, sequence)
            self._write(answers, len(prompt), max_tokens)
            texts = [self._text(answer) for answer in answers if answer.matcher.is_stopped()]
        except InterruptedEvaluationError:
            finish = "cancelled"
        return (
            texts,
            finish,
            Usage(
                prompt_tokens=len(prompt),
                cached_tokens=cached,
                completion_tokens=sum(len(answer.tokens) - len(begun) for answer in answers),
                sampled_tokens=sum(answer.sampled for answer in answers),
                first_token_s=first,
                seconds=perf_counter() - started,
            ),
        )

    def _begun(
        self, grammar: str, begun: Sequence[int], logits: NDArray[np.float32], number: int
    ) -> _Answer:
        matcher = LLMatcher(self._tokenizer, grammar, log_level=0)
        if matcher.is_error():
            raise ValueError(f"the grammar is not valid: {matcher.get_error()}")
        if begun and matcher.try_consume_tokens(list(begun)) != len(begun):
            raise ValueError("the grammar refuses how the answers are to begin")
        return _Answer(matcher, logits.copy(), np.random.default_rng(number + 1), list(begun))

    def _write(self, answers: list[_Answer], start: int, max_tokens: int) -> None:
        """Let every open answer take its next tokens, then evaluate all of them at once."""
        while True:
            for answer in answers:
                if answer.open:
                    self._advance(answer, max_tokens)
            running = [(n, answer) for n, answer in enumerate(answers) if answer.open]
            if not running:
                return
            rows = self._shared.extend(
                [
                    (number, start + len(answer.tokens) - len(answer.pending), answer.pending)
                    for number, answer in running
                ]
            )
            for (_, answer), row in zip(running, rows, strict=True):
                answer.logits = row

    def _advance(self, answer: _Answer, max_tokens: int) -> None:
        tokens = forced_tokens(answer.matcher)
        if not tokens and not answer.matcher.is_stopped():
            tokens = [self._sample(answer), *forced_tokens(answer.matcher)]
            answer.sampled += 1
        answer.pending = tokens
        answer.tokens += tokens
        answer.open = not answer.matcher.is_stopped() and len(answer.tokens) < max_tokens

    def _sample(self, answer: _Answer) -> int:
        """Draw a token; only when the grammar refuses it is the mask computed and drawn again."""
        token = _draw(answer.logits, answer.random)
        if answer.matcher.try_consume_tokens([token]) == 1:
            return token
        token = _draw(allowed_only(answer.matcher, answer.logits), answer.random)
        answer.matcher.consume_token(token)
        return token

    def _text(self, answer: _Answer) -> str:
        data = readable(self._tokenizer, answer.tokens, self._ends)
        return codecs.decode(data, "utf-8", "replace")


def _draw(logits: NDArray[np.floating[Any]], random: np.random.Generator) -> int:
    """Draw by the Gumbel trick: the largest of logits with noise is a draw of their softmax."""
    noise = random.gumbel(size=logits.size) * TEMPERATURE
    return int(np.argmax(logits + noise))
