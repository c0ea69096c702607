"""A verdict that begins with what was asked and goes on with what the console says of the plan."""

import json
import math

import pytest

from pa_console.llm.backend import EngineError
from pa_console.llm.roles.judge import Judge, Judgement, JudgeQuestion
from pa_console.llm.roles.prompts import Prompt
from tests.scripted import Answer, ScriptedEngine

OPENING = '{"feedback": "asked: 1 drone home; planned: '
WHOLE = OPENING + '1 drone home; it fits", "violated": ["WF-03"], "verdict": "Success"}'


async def judged(*answers: Answer) -> tuple[str, Judgement, list[str]]:
    """Return what was streamed, the judgement, and the grammars that were asked with."""
    engine = ScriptedEngine([], answers)
    pieces: list[str] = []
    question = JudgeQuestion(
        "judge",
        Prompt("s", "u"),
        "opening",
        ("WF-03", "ROE-01"),
        lambda said: f"whole of {said}",
    )
    found = await Judge(engine.engine()).judge(question, pieces.append)
    return "".join(pieces), found, [request.grammar for request in engine.requests]


async def test_the_whole_answer_is_streamed_once() -> None:
    text, found, grammars = await judged(OPENING, WHOLE)
    assert text == found.text == WHOLE
    assert grammars == ["opening", f"whole of {OPENING}"]
    assert found.verdict is not None
    assert found.verdict.verdict == "Success"
    assert found.verdict.feedback == json.loads(WHOLE)["feedback"]
    opinions = {rule.rule_id: rule.opinion for rule in found.verdict.rules}
    assert opinions == {"WF-03": "violates", "ROE-01": "complies"}


async def test_a_judge_is_as_sure_as_of_what_it_says_was_asked() -> None:
    chances = [(OPENING.index("drone"), math.log(0.5)), (len(OPENING) + 1, math.log(0.5))]
    engine = ScriptedEngine([], [OPENING, WHOLE], chances=chances)
    judge = Judge(engine.engine())
    question = JudgeQuestion("judge", Prompt("s", "u"), "opening", (), lambda said: said)
    assert (await judge.judge(question)).confidence == 0.5


async def test_both_parts_are_paid_for() -> None:
    _, found, _ = await judged(OPENING, WHOLE)
    assert found.usage.seconds == pytest.approx(0.02)


@pytest.mark.parametrize("answers", [(EngineError("gone"),), (OPENING, EngineError("gone"))])
async def test_an_answer_that_breaks_off_is_no_verdict(answers: tuple[Answer, ...]) -> None:
    _, found, _ = await judged(*answers)
    assert found.verdict is None
    assert "gone" in found.error
