"""Other answers to a prompt than the most likely one, decoded in one batch.

Only the worker process imports this.

Each leaves the most likely answer where the model came nearest to doing so, and goes on with what
is most likely after that: no two are alike, and equal requests give equal answers.

Only the worker process imports this. A context of its own, cleared before every use, holds the
copies, so the caches of the roles stay as they are.
"""

import codecs
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from heapq import heappop, heappush
from math import inf
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from llguidance import LLMatcher
from numpy.typing import NDArray

from pa_console.llm.backend import Finish, Request
from pa_console.llm.worker.answer import Written, forced_tokens, likeliest, readable
from pa_console.llm.worker.contexts import InterruptedEvaluationError, SharedContext
from pa_console.llm.worker.runtime import Runtime
from pa_console.schema.finding import Usage

AT_ONE_PLACE = 32
"""The number of likeliest tokens considered at each place."""

LONGEST = 8
"""The number of answer tokens that write more than any one token does."""


class BranchPoint(NamedTuple):
    """The answer's first `kept` tokens, then `token`; `chance` is the logarithm of theirs."""

    chance: float
    kept: int
    token: int


def branch_points(  # noqa: PLR0917
    matcher: LLMatcher,
    tokenizer: Any,
    answer: Sequence[int],
    rows: Iterable[NDArray[np.float32]],
    begun: int,
    count: int,
) -> list[BranchPoint]:
    """Return the `count` likeliest ways to leave `answer`, the likeliest first.

    `rows` are the logits before each of its tokens, shape (n_vocabulary,); `matcher` is at its
    start and is moved along it. Its first `begun` tokens stay, and those that the grammar forces. A
    token that writes what the answer goes on with is no way to leave it.
    """
    found: list[BranchPoint] = []
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
                    heappush(found, BranchPoint(chance + other_chance, position, other))
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


ROWS = 16
"""The number of tokens of the most likely answer evaluated at once: their logits take memory."""


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
    """Writes other likely answers."""

    def __init__(
        self, runtime: Runtime, shared: SharedContext, tokenizer: Any, ends: frozenset[int]
    ) -> None:
        """`shared` is asked to hold the copies of a sequence of `runtime`."""
        self._runtime, self._shared = runtime, shared
        self._tokenizer, self._ends = tokenizer, ends
        self._stop: re.Pattern[str] | None = None

    @property
    def width(self) -> int:
        """The number of answers that fit."""
        return self._shared.width

    def close(self) -> None:
        """Give the memory of the copies back."""
        self._shared.close()

    def answers(
        self, sequence: int, likeliest: Written, begun: int, request: Request
    ) -> tuple[list[str], Finish, Usage]:
        """Write as many answers as `request` wants to the prompt of the `likeliest` one.

        They keep its first `begun` tokens, and end where the request's regular expression `stop`
        is found, if there is one. Those that are not complete are left out. Raises ValueError when
        there is no room.
        """
        self._stop = re.compile(request.stop) if request.stop else None
        grammar, max_tokens = request.grammar, request.max_tokens
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
            found = branch_points(
                self._matcher(grammar), self._tokenizer, answer, rows, begun, request.count
            )
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
        self, grammar: str, answer: Sequence[int], branch: BranchPoint, max_tokens: int
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
