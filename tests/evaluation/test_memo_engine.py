"""An engine that remembers: one question a distinct prompt, in this run and in the next."""

from pathlib import Path

import pytest

from pa_console.evaluation.memo_engine import MemoEngine
from pa_console.llm.backend import EngineDiedError, GenerationEnd, Request
from tests.scripted import ScriptedEngine

USER = "Track_01 is {} m from WestGate, seen 2 s ago. Drone_T01 has 80 %."


def request(user: str, **changes: str) -> Request:
    words = {"role": "planner", "system": "rules", "grammar": "start: x"} | changes
    return Request(words["role"], words["system"], user, words["grammar"], 100, 10.0)  # type: ignore


async def answer(memo: MemoEngine, asked: Request) -> str:
    """Return the streamed text, which must be the completed one."""
    streamed, completed = "", list[GenerationEnd]()
    async for item in memo.generate(asked):
        if isinstance(item, GenerationEnd):
            completed.append(item)
        else:
            streamed += item
    assert [item.text for item in completed] == [streamed]
    return streamed


async def test_prompts_that_differ_only_in_metres_are_asked_once() -> None:
    engine = ScriptedEngine(["first", "second"])
    memo = MemoEngine(engine.engine())
    assert [await answer(memo, request(USER.format(m))) for m in (7, 58, 120)] == ["first"] * 3
    assert (memo.asked, memo.reused, len(engine.requests)) == (1, 2, 1)


@pytest.mark.parametrize(
    "other",
    [
        request(USER.format(7).replace("WestGate", "EastGate")),
        request(USER.format(7).replace("Track_01", "Track_02")),
        request(USER.format(7), system="other rules"),
        request(USER.format(7), grammar="start: y"),
        request(USER.format(7), role="judge"),
    ],
)
async def test_prompts_that_differ_in_anything_else_are_asked_each(other: Request) -> None:
    engine = ScriptedEngine(["first", "second"], ["verdict"])
    memo = MemoEngine(engine.engine())
    assert await answer(memo, request(USER.format(7))) == "first"
    assert await answer(memo, other) != "first"
    assert (memo.asked, memo.reused) == (2, 0)


async def test_what_was_answered_is_remembered_by_the_next_run(tmp_path: Path) -> None:
    path = tmp_path / "answers.jsonl"
    for _ in range(2):
        memo = MemoEngine(ScriptedEngine(['{"reason": "ä\\n"}']).engine(), path)
        assert await answer(memo, request(USER.format(1))) == '{"reason": "ä\\n"}'
    memo = MemoEngine(ScriptedEngine([EngineDiedError("never asked")]).engine(), path)
    await answer(memo, request(USER.format(1)))
    assert (memo.asked, memo.reused) == (0, 1)
    assert len(path.read_text(encoding="utf-8").splitlines()) == 1
    other = MemoEngine(ScriptedEngine(["another model's"]).engine(), tmp_path / "other.jsonl")
    assert await answer(other, request(USER.format(1))) == "another model's"


async def test_an_answer_that_did_not_come_is_not_remembered(tmp_path: Path) -> None:
    path = tmp_path / "answers.jsonl"
    memo = MemoEngine(ScriptedEngine([EngineDiedError("died"), "at last"]).engine(), path)
    with pytest.raises(EngineDiedError):
        await answer(memo, request(USER.format(1)))
    assert await answer(memo, request(USER.format(1))) == "at last"
    assert memo.asked == 2
    assert len(path.read_text(encoding="utf-8").splitlines()) == 1


async def test_a_torn_line_is_told_with_file_and_line(tmp_path: Path) -> None:
    path = tmp_path / "answers.jsonl"
    await answer(MemoEngine(ScriptedEngine(["fine"]).engine(), path), request("one"))
    with path.open("a", encoding="utf-8") as file:
        file.write('{"key": "12')
    with pytest.raises(ValueError, match=r"answers\.jsonl:2: .*remove the line"):
        MemoEngine(ScriptedEngine(["fine"]).engine(), path)


def test_a_worker_fault_reaches_the_engine_behind_it() -> None:
    engine = ScriptedEngine(["x"])
    MemoEngine(engine.engine()).kill_worker()
    assert engine.kills == 1
