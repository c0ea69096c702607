"""Planner and judge: whatever the engine answers becomes a plan, a verdict or a reason to hold."""

import json
from pathlib import Path

import pytest

from pa_console.llm.backend import EngineDiedError, EngineError, Finish, GenerationEnd
from pa_console.llm.models.catalogue import LocalModel
from pa_console.llm.roles.judge import Judge, Judgement, JudgeQuestion, read_verdict
from pa_console.llm.roles.planner import Planner, Proposal, read_plan
from pa_console.llm.roles.prompts import Prompt
from pa_console.schema.finding import Usage
from tests.llm.scripted import ScriptedEngine

MODEL = LocalModel("scripted", Path("none.gguf"), "0" * 64)
PROMPT = Prompt("system", "user")
PLAN = '{"reason": "quiet", "actions": [{"agent": "Hawk_1", "command": "hold"}]}'
VERDICT = (
    '{"rules": [{"id": "WF-03", "verdict": "unclear"}], "feedback": "ok", "verdict": "Failure"}'
)
USAGE = Usage(prompt_tokens=7, seconds=1.5)

Script = list[str | GenerationEnd | EngineError]


def script(text: str, finish: Finish = "stop") -> Script:
    return [text[:9], text[9:], GenerationEnd(text, USAGE, finish)]


async def propose(items: Script) -> tuple[str, Proposal]:
    pieces: list[str] = []
    planner = Planner(ScriptedEngine(MODEL, items))
    proposal = await planner.plan(PROMPT, "grammar", pieces.append)
    return "".join(pieces), proposal


async def judge(items: Script) -> tuple[str, Judgement]:
    pieces: list[str] = []
    question = JudgeQuestion("judge", PROMPT, "grammar")
    judgement = await Judge(ScriptedEngine(MODEL, items)).judge(question, pieces.append)
    return "".join(pieces), judgement


async def test_a_complete_answer_becomes_a_plan_with_its_text_and_cost():
    streamed, proposal = await propose(script(PLAN))
    assert streamed == proposal.text == PLAN
    assert proposal.plan is not None
    assert proposal.plan.actions[0].command == "hold"
    assert (proposal.error, proposal.fatal, proposal.usage) == ("", False, USAGE)


async def test_a_complete_answer_becomes_a_verdict_on_every_rule():
    streamed, judgement = await judge(script(VERDICT))
    assert streamed == judgement.text == VERDICT
    assert judgement.verdict is not None
    assert judgement.verdict.verdict == "Failure"
    assert judgement.verdict.rules[0].opinion == "unclear"
    assert judgement.usage == USAGE


@pytest.mark.parametrize(
    ("finish", "said", "fatal"),
    [
        ("length", "cut off after 700 tokens", False),
        ("cancelled", "cancelled", True),
        ("deadline", "no complete answer within 60 s", True),
    ],
)
async def test_an_answer_that_did_not_end_is_no_plan_even_if_it_reads_like_one(
    finish: Finish, said: str, fatal: bool
):
    _, proposal = await propose(script(PLAN, finish))
    assert proposal.plan is None
    assert said in proposal.error
    assert (proposal.text, proposal.fatal) == (PLAN, fatal)
    _, judgement = await judge(script(VERDICT, finish))
    assert judgement.verdict is None
    assert judgement.error


async def test_a_dead_engine_is_an_error_in_words_and_what_came_is_kept():
    died = EngineDiedError("the process died")
    streamed, proposal = await propose(['{"reason', died])
    assert streamed == proposal.text == '{"reason'
    assert (proposal.plan, proposal.error, proposal.fatal) == (None, "the process died", True)
    _, judgement = await judge([died])
    assert (judgement.verdict, judgement.error) == (None, "the process died")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "not a plan: Invalid JSON"),
        ("not json", "not a plan: Invalid JSON"),
        ('{"reason": "x"}', "actions: Field required"),
        (PLAN.replace("hold", "engage"), "actions.0.command: Value error, unknown command"),
        (PLAN.replace('"reason"', '"why": 1, "reason"'), "why: Extra inputs"),
    ],
)
def test_what_is_not_a_plan_is_told_where(text: str, said: str):
    plan, error = read_plan(text)
    assert plan is None
    assert said in error


def test_a_plan_is_read_with_its_fields_in_either_order():
    swapped = json.dumps(dict(reversed(json.loads(PLAN).items())))
    assert read_plan(swapped)[0] == read_plan(PLAN)[0] is not None


@pytest.mark.parametrize("change", [("Failure", "Maybe"), ("unclear", "fine"), ("feedback", "x")])
def test_what_is_not_a_verdict_is_told(change: tuple[str, str]):
    verdict, error = read_verdict(VERDICT.replace(*change))
    assert verdict is None
    assert "not a verdict" in error
