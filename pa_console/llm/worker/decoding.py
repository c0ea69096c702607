"""Greedy decoding with one model: an answer under a grammar, or several at once.

Only the worker process imports this.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from llguidance import LLMatcher
from llguidance.llamacpp import lltokenizer_from_vocab

from pa_console.llm.backend import Chance, Finish, Request
from pa_console.llm.worker.answer import AnswerRun, Written
from pa_console.llm.worker.candidates import Candidates
from pa_console.llm.worker.runtime import Runtime
from pa_console.schema.finding import Usage

AT_ONCE = 5
"""The number of short answers that can be written at once without a new context."""

STEP = 256
"""The context for several answers is a multiple of this number of tokens: it takes memory."""


class Decoder:
    """Writes answers with one model; temperature 0, so the same prompt gives the same answer."""

    def __init__(self, runtime: Runtime) -> None:
        self._runtime = runtime
        self._ends = frozenset(runtime.end_tokens)
        vocabulary: Any = runtime.vocabulary
        self._tokenizer = lltokenizer_from_vocab(vocabulary, eos_token=sorted(self._ends))
        self._candidates: Candidates | None = None
        self._room = 0
        self._last: dict[int, Written] = {}
        self.written: tuple[int, ...] = ()
        """The tokens of the last answer."""
        self.chances: tuple[Chance, ...] = ()
        """The probabilities of the chosen tokens, unless it continued another answer."""

    def answer(
        self,
        sequence: int,
        prompt: Sequence[int],
        request: Request,
        on_text: Callable[[str], None],
    ) -> tuple[Finish, Usage]:
        """Write the answer to `request`, whose tokens are `prompt`, giving text as it comes.

        What the answer may repeat is guessed from the prompt and from the request's `hint`. When
        the last answer in `sequence` was to this prompt and its text is `begun`, the new one goes
        on from there. Returns why it ended and what it cost. Raises ValueError when the grammar
        (lark) is not valid or prompt and answer do not fit in the context.
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
            self._last[sequence] = Written(context[: len(prompt)], self.written, run.text, run.done)
        return finish, run.usage(len(prompt))

    def several(
        self, sequence: int, prompt: Sequence[int], request: Request
    ) -> tuple[list[str], Finish, Usage]:
        """Write the answers to `request` other than the most likely one, all in one batch.

        Those that are complete are returned, the likeliest first. They keep of the most likely
        answer what `begun` says, its beginning, and leave it before the end of `within`, if that is
        given, another beginning of it. Each ends where the regular expression `stop` is found in
        it, if there is one. Raises ValueError as `answer` does.
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
        candidates = self._room_for(request.count, len(prompt) + request.count * request.max_tokens)
        return candidates.answers(sequence, last, kept, request)

    def _room_for(self, count: int, tokens: int) -> Candidates:
        """Return what writes `count` answers at once, `tokens` together with their prompt."""
        if self._candidates is None or self._candidates.width < count or self._room < tokens:
            if self._candidates is not None:
                self._candidates.close()
            self._room = max(self._room, -(-tokens // STEP) * STEP)
            shared = self._runtime.shared_context(max(count, AT_ONCE), self._room)
            self._candidates = Candidates(self._runtime, shared, self._tokenizer, self._ends)
        return self._candidates

    def _fits(self, prompt: Sequence[int], max_tokens: int) -> None:
        room = self._runtime.n_ctx - max_tokens
        if len(prompt) > room:
            raise ValueError(
                f"the prompt has {len(prompt)} tokens and at most {room} fit beside an answer of "
                f"{max_tokens} in the model's context of {self._runtime.n_ctx}: shorten the mission"
            )
