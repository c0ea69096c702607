"""Every reason that the teacher gives can be written: it states only what the picture says."""

import json

import pytest
from llguidance import LLMatcher, LLTokenizer

from pa_console.language.clause_grammar import grounded_reason
from pa_console.llm.roles.grammar import plan_grammar
from pa_training.teacher.teacher import teach
from tests.written import SITUATIONS, given

BYTES = LLTokenizer("byte")
WHOLE = 190
"""Shorter reasons are not cut short."""


@pytest.mark.parametrize("number", range(3, SITUATIONS, 8))
def test_what_the_teacher_says_can_be_said(number: int) -> None:
    there, orders = given(number)
    world, picture, digest = there.world, there.picture, there.digest
    for one in orders:
        grammar = plan_grammar(world, picture, reasons=grounded_reason(world, digest, one.text))
        plan = teach(one.order, world, picture, digest).plan
        actions = [{"agent": a.agent, "command": a.command} for a in plan.actions]
        text = json.dumps({"reason": plan.reason, "actions": actions})
        matcher = LLMatcher(BYTES, grammar)
        tokens = BYTES.tokenize_str(text)
        whole = matcher.try_consume_tokens(tokens) == len(tokens)
        assert (whole and matcher.is_accepting()) or len(plan.reason) > WHOLE, plan.reason
