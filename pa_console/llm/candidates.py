"""Other answers to a prompt than the most likely one, decoded in one batch.

Each leaves the most likely answer where the model came nearest to doing so, and goes on with what
is most likely after that: no two are alike, and equal requests give equal answers.

Only the worker process imports this. A context of its own, cleared before every use, holds the
copies, so the caches of the roles stay as they are.
"""

import codecs
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

import numpy as np
from llguidance import LLMatcher
from numpy.typing import NDArray

from pa_console.llm.answer_run import Written
from pa_console.llm.branches import Branch, branches
from pa_console.llm.protocol import Finish
from pa_console.llm.runtime import Runtime
from pa_console.llm.shared_context import InterruptedEvaluationError, SharedContext
from pa_console.llm.token_choice import forced_tokens, likeliest, readable
from pa_console.schema.finding import Usage

ROWS = 16
"""So many tokens of the most likely answer are evaluated at once: their logits take memory."""


@dataclass
class _Answer:
    """One answer being written; `open` until it is complete or too long."""

    matcher: LLMatcher
    tokens: list[int]
    pending: list[int] = field(default_factory=list[int])
    """The last of them, which are not evaluated."""
    sampled: int = 1
    open: bool = True
    complete: bool = False


class Candidates:
    """Writes what the model might have said instead."""

    def __init__(
        self, runtime: Runtime, shared: SharedContext, tokenizer: Any, ends: frozenset[int]
    ) -> None:
        """`shared` is asked to hold the copies of a sequence of `runtime`."""
        self._runtime, self._shared = runtime, shared
        self._tokenizer, self._ends = tokenizer, ends
        self._stop: re.Pattern[str] | None = None

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
        likeliest: Written,
        begun: int,
        grammar: str,
        max_tokens: int,
        count: int,
        stop: str = "",
    ) -> tuple[list[str], Finish, Usage]:
        """Write up to `count` answers to the prompt of the `likeliest` one.

        They keep its first `begun` tokens, and end where the regular expression `stop` is found,
        if there is one. Those that are not complete are left out. Raises ValueError when there is
        no room.
        """
        self._stop = re.compile(stop) if stop else None
        prompt, answer = likeliest.prompt, likeliest.tokens
        started = perf_counter()
        texts: list[str] = []
        answers: list[_Answer] = []
        cached, first = 0, 0.0
        finish: Finish = "stop"
        try:
            logits, cached = self._runtime.begin(sequence, prompt)
            first = perf_counter() - started
            rows = self._rows(sequence, len(prompt), answer, logits.copy())
            found = branches(self._matcher(grammar), self._tokenizer, answer, rows, begun, count)
            answers = [self._begun(grammar, answer, branch, max_tokens) for branch in found]
            lengths = [len(prompt) + branch.kept for branch in found]
            self._shared.adopt(self._runtime.state(sequence), lengths, sequence)
            self._write(answers, len(prompt), max_tokens)
            texts = [self._text(answer) for answer in answers if answer.complete]
        except InterruptedEvaluationError:
            finish = "cancelled"
        return (
            texts,
            finish,
            Usage(
                prompt_tokens=len(prompt),
                cached_tokens=cached,
                completion_tokens=sum(len(answer.tokens) for answer in answers),
                sampled_tokens=sum(answer.sampled for answer in answers),
                first_token_s=first,
                seconds=perf_counter() - started,
            ),
        )

    def _matcher(self, grammar: str) -> LLMatcher:
        return LLMatcher(self._tokenizer, grammar, log_level=0)

    def _rows(
        self, sequence: int, start: int, answer: Sequence[int], logits: NDArray[np.float32]
    ) -> Iterator[NDArray[np.float32]]:
        """Evaluate `answer` from position `start` on; yield the logits before each token."""
        for at in range(0, len(answer), ROWS):
            tokens = answer[at : at + ROWS]
            after = self._runtime.extend(sequence, start + at, tokens, len(tokens))
            yield logits
            yield from after[:-1]
            logits = after[-1]

    def _begun(
        self, grammar: str, answer: Sequence[int], branch: Branch, max_tokens: int
    ) -> _Answer:
        begun = _Answer(self._matcher(grammar), list(answer[: branch.kept]))
        begun.matcher.consume_tokens([*begun.tokens, branch.token])
        self._take([branch.token, *forced_tokens(begun.matcher)], begun, max_tokens)
        return begun

    def _write(self, answers: list[_Answer], start: int, max_tokens: int) -> None:
        """Let every open answer take its next tokens, all of them evaluated at once."""
        while running := [(n, answer) for n, answer in enumerate(answers) if answer.open]:
            rows = self._shared.extend(
                [
                    (number, start + len(answer.tokens) - len(answer.pending), answer.pending)
                    for number, answer in running
                ]
            )
            for (_, answer), row in zip(running, rows, strict=True):
                tokens = forced_tokens(answer.matcher)
                if not tokens:
                    tokens = [likeliest(answer.matcher, row), *forced_tokens(answer.matcher)]
                    answer.sampled += 1
                self._take(tokens, answer, max_tokens)

    def _take(self, tokens: list[int], answer: _Answer, max_tokens: int) -> None:
        answer.pending = tokens
        answer.tokens += tokens
        found = self._stop is not None and self._stop.search(self._text(answer)) is not None
        answer.complete = found or answer.matcher.is_stopped()
        answer.open = not answer.complete and len(answer.tokens) < max_tokens

    def _text(self, answer: _Answer) -> str:
        data = readable(self._tokenizer, answer.tokens, self._ends)
        return codecs.decode(data, "utf-8", "replace")
