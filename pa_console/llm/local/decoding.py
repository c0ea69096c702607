"""Greedy decoding with one model: prompts as tokens, and one or several answers under a grammar.

If several answers are requested, each branches off from the most likely answer at one of the points
where another token was most probable, and continues with the most likely tokens. All answers
differ, and equal requests give equal answers. Only the worker process imports this module.
"""

import codecs
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from heapq import heappop, heappush
from math import inf
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from llama_cpp.llama_chat_format import Jinja2ChatFormatter
from llguidance import LLMatcher
from llguidance.llamacpp import lltokenizer_from_vocab
from numpy.typing import NDArray

from pa_console.llm.backend import Chance, ChatFormat, Finish, Request
from pa_console.llm.local.answer import (
    AnswerRun,
    FinishedAnswer,
    forced_tokens,
    likeliest,
    readable,
)
from pa_console.llm.local.runtime import InterruptedEvaluationError, Runtime, SharedContext
from pa_console.schema.finding import Usage

FORMATS: dict[ChatFormat, str] = {
    "chatml": (
        "{% for message in messages %}<|im_start|>{{ message.role }}\n"
        "{{ message.content }}<|im_end|>\n{% endfor %}{{ '<|im_start|>assistant\n' }}"
    ),
    "plain": "{% for message in messages %}{{ message.content }}\n\n{% endfor %}{{ 'Answer:\n' }}",
}
"""Built-in formats; a model with the format `template` has its own in the GGUF metadata."""

SYSTEM, USER = "\ue000", "\ue001"
"""The placeholders for messages while the template is rendered. A message is therefore never parsed
as part of the template, so no text can forge a control token or another role's turn."""

AT_ONE_PLACE = 32
"""The number of likeliest tokens considered at each place."""

LONGEST = 8
"""A number of answer tokens that always have more text than any single token has."""
ROWS = 16
"""The number of tokens of the most likely answer evaluated at once; it limits the memory for
logits."""


class ChatPrompt:
    """The chat format of one model."""

    def __init__(self, runtime: Runtime, chat: ChatFormat) -> None:
        self._runtime = runtime
        template = runtime.metadata("tokenizer.chat_template") if chat == "template" else None
        if template is None:
            template = FORMATS["plain" if chat == "template" else chat]
        formatter = Jinja2ChatFormatter(
            template,
            eos_token=runtime.token_text(runtime.end_token),
            bos_token=runtime.token_text(runtime.start_token),
        )
        try:
            self._frame = formatter(
                messages=[
                    {"role": "system", "content": SYSTEM},
                    {"role": "user", "content": USER},
                ]
            ).prompt
        except Exception:  # a template without a system role may raise anything
            both = f"{SYSTEM}\n\n{USER}"
            self._frame = formatter(messages=[{"role": "user", "content": both}]).prompt

    def tokens(self, system: str, user: str) -> list[int]:
        """Return the whole prompt as tokens, up to the beginning of the answer."""
        texts = {SYSTEM: system, USER: user}
        tokens: list[int] = []
        for part in re.split(f"([{SYSTEM}{USER}])", self._frame):
            if part in texts:
                tokens += self._runtime.tokenise(texts[part], special=False)
            elif part:
                tokens += self._runtime.tokenise(part, special=True)
        start = self._runtime.start_token
        if self._runtime.wants_start_token and tokens[:1] != [start]:
            tokens.insert(0, start)
        return tokens

    def closing(self) -> list[int]:
        """Return the tokens between the end of the user's message and the model's answer."""
        return self._runtime.tokenise(self._frame.rpartition(USER)[2], special=True)


class BranchPoint(NamedTuple):
    """The first `kept` tokens of the answer, followed by `token`.

    `chance` is the log probability of all of them.
    """

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
    """Return the `count` likeliest branches from `answer`, the likeliest first.

    `rows` are the logits before each token of `answer`, shape (n_vocabulary,). `matcher` is at the
    start of the answer and is advanced along it. There are no branches at the first `begun` tokens
    and at tokens that the grammar forces. A token is not a branch if it spells the same text as the
    answer.
    """
    branches: list[BranchPoint] = []
    """The likeliest branches so far, the least likely first."""
    chance, forced_to = 0.0, 0
    for position, (token, row) in enumerate(zip(answer, rows, strict=True)):
        if matcher.is_stopped():
            break
        if position >= forced_to:
            forced_to = position + len(matcher.compute_ff_tokens())
        if position >= max(forced_to, begun):
            least = branches[0].chance - chance if len(branches) == count else -inf
            chances = _chances(matcher, row, token, least)
            text = tokenizer.decode_bytes(list(answer[position : position + LONGEST]))
            for other, other_chance in chances.items():
                if not text.startswith(tokenizer.decode_bytes([other])):
                    heappush(branches, BranchPoint(chance + other_chance, position, other))
                    if len(branches) > count:
                        heappop(branches)
            chance += chances[token]
        matcher.consume_token(token)
    return sorted(branches, reverse=True)


def _chances(
    matcher: LLMatcher, row: NDArray[np.float32], token: int, least: float
) -> dict[int, float]:
    """Return the log probabilities of `token` and of the most likely allowed tokens.

    Tokens that cannot exceed `least` are left out before the grammar is checked, because inside
    long texts a check is expensive. So is the mask over the whole vocabulary.
    """
    likely = np.argpartition(-row, AT_ONE_PLACE)[:AT_ONE_PLACE]
    at_most = row[likely] - np.logaddexp(row[likely], row[token])
    candidates = likely[at_most >= least].tolist()
    allowed = [t for t in candidates if t != token and matcher.validate_tokens([t]) == 1]
    values = row[[token, *allowed]].astype(np.float64)
    values -= np.logaddexp.reduce(values)
    return dict(zip([token, *allowed], values.tolist(), strict=True))


@dataclass
class _OpenAnswer:
    """An answer being written; `open` is True until it is complete or too long."""

    matcher: LLMatcher
    tokens: list[int]
    pending: list[int] = field(default_factory=list[int])
    """The last tokens, which have not been evaluated yet."""
    sampled: int = 1
    open: bool = True
    complete: bool = False


class Candidates:
    """A writer of alternative answers to `request`, the likeliest first."""

    def __init__(
        self,
        runtime: Runtime,
        shared: SharedContext,
        tokenizer: Any,
        ends: frozenset[int],
        request: Request,
    ) -> None:
        """Prepare for answers; `shared` will hold the copies of a sequence of `runtime`."""
        self._runtime, self._shared, self._request = runtime, shared, request
        self._tokenizer, self._ends = tokenizer, ends
        self._stop = re.compile(request.stop) if request.stop else None

    def answers(
        self, sequence: int, likeliest: FinishedAnswer, begun: int
    ) -> tuple[list[str], Finish, Usage]:
        """Write alternatives to the answer `likeliest`; return them, with the end and the cost.

        They keep the first `begun` tokens of `likeliest`, and end at the first match of the
        request's regular expression `stop`, if any. Incomplete answers are left out. Raises
        ValueError if the context has no room for them.
        """
        prompt, answer = likeliest.prompt, likeliest.tokens
        started = perf_counter()
        texts: list[str] = []
        answers: list[_OpenAnswer] = []
        cached, first = 0, 0.0
        finish: Finish = "stop"
        try:
            logits, cached = self._runtime.begin(sequence, prompt)
            first = perf_counter() - started
            rows = self._rows(sequence, len(prompt), answer, logits.copy())
            count = self._request.count
            branches = branch_points(self._matcher(), self._tokenizer, answer, rows, begun, count)
            answers = [self._begun(answer, branch) for branch in branches]
            lengths = [len(prompt) + branch.kept for branch in branches]
            self._shared.adopt(self._runtime.state(sequence), lengths, sequence)
            self._write(answers, len(prompt))
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

    def _matcher(self) -> LLMatcher:
        return LLMatcher(self._tokenizer, self._request.grammar, log_level=0)

    def _rows(
        self, sequence: int, start: int, answer: Sequence[int], logits: NDArray[np.float32]
    ) -> Iterator[NDArray[np.float32]]:
        """Evaluate `answer` from position `start`; yield the logits before each token."""
        for at in range(0, len(answer), ROWS):
            tokens = answer[at : at + ROWS]
            after = self._runtime.extend(sequence, start + at, tokens, len(tokens))
            yield logits
            yield from after[:-1]
            logits = after[-1]

    def _begun(self, answer: Sequence[int], branch: BranchPoint) -> _OpenAnswer:
        begun = _OpenAnswer(self._matcher(), list(answer[: branch.kept]))
        begun.matcher.consume_tokens([*begun.tokens, branch.token])
        self._take([branch.token, *forced_tokens(begun.matcher)], begun)
        return begun

    def _write(self, answers: list[_OpenAnswer], start: int) -> None:
        """Extend all open answers until they are complete, each by its next tokens at a time.

        The next tokens of all answers are evaluated together.
        """
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
                self._take(tokens, answer)

    def _take(self, tokens: list[int], answer: _OpenAnswer) -> None:
        answer.pending = tokens
        answer.tokens += tokens
        stopped = self._stop is not None and self._stop.search(self._text(answer)) is not None
        answer.complete = stopped or answer.matcher.is_stopped()
        answer.open = not answer.complete and len(answer.tokens) < self._request.max_tokens

    def _text(self, answer: _OpenAnswer) -> str:
        data = readable(self._tokenizer, answer.tokens, self._ends)
        return codecs.decode(data, "utf-8", "replace")


class Decoder:
    """A writer of answers with one model, at temperature 0: equal prompts have equal answers."""

    def __init__(self, runtime: Runtime) -> None:
        self._runtime = runtime
        self._ends = frozenset(runtime.end_tokens)
        vocabulary: Any = runtime.vocabulary
        # `slices` are for free text and take 13 MB. With the grammars of this project, masks are
        # computed as fast without them.
        self._tokenizer = lltokenizer_from_vocab(
            vocabulary, eos_token=sorted(self._ends), slices=[]
        )
        self._last: dict[int, FinishedAnswer] = {}
        self.written: tuple[int, ...] = ()
        """The tokens of the last answer."""
        self.chances: tuple[Chance, ...] = ()
        """The probabilities of the tokens that the model chose in the last answer.

        If the answer continued another one, the tokens of the other answer have none.
        """

    def answer(
        self,
        sequence: int,
        prompt: Sequence[int],
        request: Request,
        on_text: Callable[[str], None],
    ) -> tuple[Finish, Usage]:
        """Write the answer to `request` with the tokens `prompt`, and pass pieces to `on_text`.

        Repetitions are guessed from the prompt and from the request's `hint`. If the last answer in
        `sequence` was to this prompt and has the text `begun`, the new answer continues it. Returns
        the reason for the end, and the cost. Raises ValueError if the grammar (lark) is not valid,
        or if prompt and answer do not fit in the context.
        """
        hint, begun, max_tokens = request.hint, request.begun, request.max_tokens
        self._fits(prompt, max_tokens)
        last = self._last.pop(sequence, None)
        matcher = LLMatcher(self._tokenizer, request.grammar, log_level=0)
        if matcher.is_error():
            raise ValueError(f"the grammar is not valid: {matcher.get_error()}")
        hinted = self._runtime.tokenise(hint, special=False) if hint else []
        run = AnswerRun(self._runtime, self._tokenizer, matcher, self._ends, on_text, hinted)
        context = list(prompt)
        if last is not None and begun and last.is_of(context, begun):
            finish = run.go_on(sequence, context, last, max_tokens)
        else:
            finish = run.write(sequence, context, max_tokens)
        self.written, self.chances = tuple(context[len(prompt) :]), tuple(run.chances)
        if finish == "stop":
            self._last[sequence] = FinishedAnswer(
                context[: len(prompt)], self.written, run.text, run.done
            )
        return finish, run.usage(len(prompt))

    def several(
        self, sequence: int, prompt: Sequence[int], request: Request
    ) -> tuple[list[str], Finish, Usage]:
        """Write alternatives to the most likely answer to `request`, all in one batch.

        Complete answers are returned, the likeliest first, with the reason for the end and the
        cost. They keep the beginning `begun` of the most likely answer. If the longer beginning
        `within` is given, they diverge from the most likely answer before the end of it. Each ends
        at the first match of the regular expression `stop`, if any. Raises ValueError as `answer`
        does.
        """
        last = self._last.get(sequence)
        if last is None or last.prompt != list(prompt):
            alone = replace(request, hint="", begun="")
            finish, usage = self.answer(sequence, prompt, alone, lambda _text: None)
            last = self._last.get(sequence)
            if last is None:
                return [], finish, usage
        del self._last[sequence]
        begun, within = request.begun, request.within
        kept = last.within(begun, self._tokenizer) if last.text.startswith(begun) else 0
        if within and last.text.startswith(within):
            last = replace(last, tokens=last.tokens[: last.within(within, self._tokenizer)])
        room = len(prompt) + request.count * request.max_tokens
        # The shared context is created in 30 ms. It is freed at once, because it takes more memory
        # than any other context.
        with closing(SharedContext(self._runtime, request.count, room)) as shared:
            several = Candidates(self._runtime, shared, self._tokenizer, self._ends, request)
            return several.answers(sequence, last, kept)

    def _fits(self, prompt: Sequence[int], max_tokens: int) -> None:
        room = self._runtime.n_ctx - max_tokens
        if len(prompt) > room:
            raise ValueError(
                f"the prompt has {len(prompt)} tokens, but at most {room} fit beside an answer of "
                f"{max_tokens} in the model's context of {self._runtime.n_ctx}: shorten the mission"
            )
