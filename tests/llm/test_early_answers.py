"""Answers that were asked for before a mission needs them."""

import asyncio
from collections.abc import AsyncGenerator
from dataclasses import replace

import pytest

from pa_console.llm.backend import Answerer, EngineError, GenerationEnd, Request, ask_model
from pa_console.llm.early_answers import MOST_KEPT, EarlyAnswers
from pa_console.schema.finding import Usage

REQUEST = Request("planner", "system", "user", 'start: "{"', 10, 5.0)


class Slow:
    """Writes `a`, then `b` once it may go on; says how often it was asked, and how."""

    name = "slow"

    def __init__(self) -> None:
        self.requests: list[Request] = []
        self.go = asyncio.Event()
        self.ended = 0
        self.fails = self.interrupted = False

    def interrupt(self) -> None:
        """End what yields, as an engine does for an urgent prompt."""
        self.interrupted = True
        self.go.set()

    async def generate(self, request: Request) -> AsyncGenerator[str | GenerationEnd]:
        """Write two pieces."""
        self.requests.append(request)
        try:
            yield "a"
            await self.go.wait()
            if self.fails and request.yields:
                raise EngineError("broken")
            if self.interrupted and request.yields:
                yield GenerationEnd("a", Usage(seconds=1.0), "cancelled")
                return
            yield "b"
            yield GenerationEnd("ab", Usage(seconds=3.0), "stop", chances=((0, -0.1),))
        finally:
            self.ended += 1


async def turns() -> None:
    for _ in range(20):
        await asyncio.sleep(0)


async def whole(model: Answerer, request: Request = REQUEST) -> tuple[str, list[str], float]:
    pieces: list[str] = []
    answer = await ask_model(model, request, pieces.append)
    return answer.text, pieces, answer.usage.ahead_s


@pytest.fixture
def slow() -> Slow:
    return Slow()


async def test_an_early_answer_comes_at_once_and_only_once(slow: Slow) -> None:
    early = EarlyAnswers()
    slow.go.set()
    await whole(early.ahead(slow))
    text, pieces, ahead_s = await whole(early.due(slow))
    assert (text, pieces) == ("ab", ["a", "b"])
    assert 0.0 < ahead_s < 3.0
    assert [request.yields for request in slow.requests] == [True]
    assert (await whole(early.due(slow)))[2] == 0.0
    assert [request.yields for request in slow.requests] == [True, False]


@pytest.mark.parametrize(
    "other",
    [
        replace(REQUEST, user="another picture"),
        replace(REQUEST, role="judge"),
        replace(REQUEST, grammar='start: "["'),
        replace(REQUEST, count=4),
        replace(REQUEST, begun="a"),
        replace(REQUEST, system="another world"),
    ],
)
async def test_any_other_request_is_asked_for_itself(slow: Slow, other: Request) -> None:
    early = EarlyAnswers()
    slow.go.set()
    await whole(early.ahead(slow))
    assert (await whole(early.due(slow), other))[2] == 0.0
    assert slow.requests[-1] == other


async def test_the_answer_of_another_model_is_not_taken(slow: Slow) -> None:
    early, other = EarlyAnswers(), Slow()
    slow.go.set()
    other.go.set()
    await whole(early.ahead(slow))
    await whole(early.due(other))
    assert len(other.requests) == 1


async def test_an_answer_that_is_being_written_is_followed_to_its_end(slow: Slow) -> None:
    early = EarlyAnswers()
    draft = asyncio.create_task(whole(early.ahead(slow)))
    await turns()
    draft.cancel()
    mission = asyncio.create_task(whole(early.due(slow)))
    await turns()
    slow.go.set()
    text, pieces, ahead_s = await mission
    assert (text, pieces, len(slow.requests)) == ("ab", ["a", "b"], 1)
    assert 0.0 < ahead_s < 3.0


@pytest.mark.parametrize("how", ["interrupted", "failed"])
async def test_where_it_breaks_off_the_model_is_asked_and_no_piece_comes_twice(
    slow: Slow, how: str
) -> None:
    early = EarlyAnswers()
    draft = asyncio.create_task(whole(early.ahead(slow)))
    await turns()
    mission = asyncio.create_task(whole(early.due(slow)))
    await turns()
    draft.cancel()
    if how == "failed":
        slow.fails = True
        slow.go.set()
        await turns()
        slow.fails = False
    else:
        assert early.take(slow, REQUEST) is None
        slow.go.set()
    text, pieces, _ = await mission
    assert (text, pieces) == ("ab", ["a", "b"])


async def test_stopping_frees_the_model_and_keeps_what_is_complete(slow: Slow) -> None:
    early, other = EarlyAnswers(), replace(REQUEST, user="another")
    slow.go.set()
    await whole(early.ahead(slow))
    slow.go.clear()
    draft = asyncio.create_task(whole(early.ahead(slow), other))
    await turns()
    early.stop()
    text, _, _ = await draft
    assert text == ""
    assert slow.ended == 2
    assert (await whole(early.due(slow)))[0] == "ab"
    assert len(slow.requests) == 2


async def test_a_mission_that_is_cancelled_leaves_nothing_running(slow: Slow) -> None:
    early = EarlyAnswers()
    draft = asyncio.create_task(whole(early.ahead(slow)))
    mission = asyncio.create_task(whole(early.due(slow)))
    await turns()
    draft.cancel()
    mission.cancel()
    await turns()
    assert slow.ended == len(slow.requests)


async def test_the_oldest_answers_are_forgotten(slow: Slow) -> None:
    early = EarlyAnswers()
    slow.go.set()
    for number in range(MOST_KEPT + 1):
        await whole(early.ahead(slow), replace(REQUEST, user=f"{number}"))
    asked = len(slow.requests)
    await whole(early.due(slow), replace(REQUEST, user="1"))
    assert len(slow.requests) == asked
    await whole(early.due(slow), replace(REQUEST, user="0"))
    assert len(slow.requests) == asked + 1
