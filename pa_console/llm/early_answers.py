"""Answers requested from models before a mission needs them; each is used once.

While an order is typed, its draft asks models through `ahead`, and every answer is kept. A mission
asks through `due`. If there is a kept answer to exactly the same request, it is used at once;
otherwise the request goes to the model. Decoding is greedy, so both answers would be the same; only
the wait differs.
"""

import asyncio
from collections.abc import AsyncGenerator, Callable
from contextlib import aclosing
from dataclasses import replace
from time import perf_counter

from pa_console.llm.backend import Answerer, EngineError, GenerationEnd, Request
from pa_console.schema.finding import Usage

MOST_KEPT = 32
"""The number of answers that are kept, enough for the last few drafts."""

_Key = tuple[Answerer, Request]


class EarlyAnswers:
    """The finished and unfinished answers that are kept for one session."""

    def __init__(self) -> None:
        self._kept: dict[_Key, _EarlyAnswer] = {}

    def ahead(self, model: Answerer) -> Answerer:
        """Return `model` for a draft: answers are kept, and more urgent prompts interrupt them."""
        return _Ahead(model, self)

    def due(self, model: Answerer) -> Answerer:
        """Return `model` for a mission: if an answer is kept, finished or not, it is used."""
        return _Due(model, self)

    def stop(self) -> None:
        """Stop all unfinished answers; complete ones stay."""
        for early in list(self._kept.values()):
            early.stop()

    def begin(self, model: Answerer, request: Request) -> "_EarlyAnswer":
        """Return the kept answer to `request`; if there is none, the model begins to write one."""
        key = _key(model, request)
        if key not in self._kept:
            pieces = model.generate(replace(request, yields=True))
            self._kept[key] = _EarlyAnswer(pieces, lambda early: self._forget(key, early))
            for oldest in list(self._kept)[:-MOST_KEPT]:
                self._kept.pop(oldest).stop()
        return self._kept[key]

    def _forget(self, key: _Key, early: "_EarlyAnswer") -> None:
        if self._kept.get(key) is early:
            del self._kept[key]

    def take(self, model: Answerer, request: Request) -> "_EarlyAnswer | None":
        """Remove and return the kept answer to `request`; None if there is none."""
        return self._kept.pop(_key(model, request), None)


def _key(model: Answerer, request: Request) -> _Key:
    """Return all that an answer depends on.

    The schema is left out because it has the same content as the grammar. `yields` is left out
    because it does not change the answer.
    """
    return model, replace(request, schema=None, yields=False)


class _EarlyAnswer:
    """An unfinished or complete answer; several callers may follow it."""

    def __init__(
        self, pieces: AsyncGenerator[str | GenerationEnd], forget: "Callable[[_EarlyAnswer], None]"
    ) -> None:
        """Begin to collect `pieces`; `forget` is called if they do not become a complete answer."""
        self.began_s = perf_counter()
        self._items: list[str | GenerationEnd] = []
        self._grown = asyncio.Event()
        self._over = False
        self._forget = forget
        self._writing = asyncio.create_task(self._write(pieces), name="early answer")

    def stop(self) -> None:
        """Stop writing; an answer that is already complete is kept."""
        self._writing.cancel()

    async def follow(self) -> AsyncGenerator[str | GenerationEnd]:
        """Yield the pieces so far and all later ones, then a GenerationEnd if writing completes."""
        at = 0
        while True:
            grown = self._grown
            while at < len(self._items):
                yield self._items[at]
                at += 1
            if self._over:
                return
            await grown.wait()

    async def _write(self, pieces: AsyncGenerator[str | GenerationEnd]) -> None:
        complete = False
        try:
            async with aclosing(pieces):
                async for item in pieces:
                    self._items.append(item)
                    complete = isinstance(item, GenerationEnd) and item.finish == "stop"
                    self._tell()
        except EngineError:
            pass  # the mission asks again, and reports the error if it recurs
        finally:
            self._over = True
            if not complete:
                self._forget(self)
            self._tell()

    def _tell(self) -> None:
        self._grown.set()
        self._grown = asyncio.Event()


class _WithAnswers:
    """A model, together with the answers that are kept for one session."""

    def __init__(self, model: Answerer, answers: EarlyAnswers) -> None:
        self._model, self._answers = model, answers

    @property
    def name(self) -> str:
        """The model's name."""
        return self._model.name


class _Ahead(_WithAnswers):
    """A model for a draft."""

    async def generate(self, request: Request) -> AsyncGenerator[str | GenerationEnd]:
        """Yield the answer; the model continues to write it if the caller is cancelled."""
        async with aclosing(self._answers.begin(self._model, request).follow()) as items:
            async for item in items:
                yield item
                if isinstance(item, GenerationEnd):
                    return
        yield GenerationEnd("", Usage(), "cancelled")


class _Due(_WithAnswers):
    """A model for a mission."""

    async def generate(self, request: Request) -> AsyncGenerator[str | GenerationEnd]:
        """Yield the kept answer, with the time spent on it before now; otherwise ask the model."""
        passed_on = 0
        early = self._answers.take(self._model, request)
        if early is not None:
            ahead_s = perf_counter() - early.began_s
            try:
                async with aclosing(early.follow()) as items:
                    async for item in items:
                        if isinstance(item, str):
                            passed_on += len(item)
                            yield item
                        elif item.finish == "stop":
                            ahead = {"ahead_s": min(ahead_s, item.usage.seconds)}
                            yield replace(item, usage=item.usage.model_copy(update=ahead))
                            return
            finally:
                early.stop()
        # If an early answer was interrupted, the model repeats it from its beginning.
        async with aclosing(self._model.generate(request)) as items:
            async for item in items:
                if isinstance(item, str):
                    fresh, passed_on = item[passed_on:], max(0, passed_on - len(item))
                    if fresh:
                        yield fresh
                else:
                    yield item
