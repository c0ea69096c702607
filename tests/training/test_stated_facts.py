"""Every reason that the teacher gives can be written: it states only what the picture says."""

import json
import random

from hypothesis import given, settings
from hypothesis import strategies as st
from llguidance import LLMatcher, LLTokenizer
from pa_training.order_generator.orders import is_so
from pa_training.order_generator.sampler import sample_order
from pa_training.phrasing.phrasing import phrase

from pa_console.language.canonical.facts import DigestFacts, holds
from pa_console.language.clause_grammar import grounded_reason
from pa_console.llm.roles.grammar import plan_grammar
from pa_training.situations.situations import random_situation
from pa_training.situations.worlds import random_world
from pa_training.teacher.teacher import teach

BYTES = LLTokenizer("byte")
WHOLE = 190
"""Shorter reasons are not cut short."""


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6))
def test_what_the_teacher_says_can_be_said(seed: int) -> None:
    rng = random.Random(seed)
    situation = random_situation(rng, random_world(rng))
    world, picture, digest = situation.world, situation.picture, situation.digest
    for _ in range(8):
        order, _ = sample_order(rng, world, picture, digest)
        words = phrase(order, world, picture, rng).text
        grammar = plan_grammar(world, picture, reasons=grounded_reason(world, digest, words))
        plan = teach(order, world, picture, digest).plan
        actions = [{"agent": a.agent, "command": a.command} for a in plan.actions]
        text = json.dumps({"reason": plan.reason, "actions": actions})
        matcher = LLMatcher(BYTES, grammar)
        tokens = BYTES.tokenize_str(text)
        whole = matcher.try_consume_tokens(tokens) == len(tokens)
        assert (whole and matcher.is_accepting()) or len(plan.reason) > WHOLE, plan.reason
        if order.condition is not None:
            truth = holds(order.condition, DigestFacts(digest))
            assert truth is None or truth is is_so(order.condition, picture)
