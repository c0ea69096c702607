"""Grammars: every plan of the vocabulary is writable, nothing else is."""

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from llguidance import LLMatcher, LLTokenizer

from pa_console.llm.local.decoding import branch_points
from pa_console.llm.roles.grammar import (
    REASON_CHARS,
    compact_judge_grammar,
    judge_grammar,
    plan_grammar,
)
from pa_console.llm.roles.judge import read_verdict
from pa_console.schema.command import COMMANDS, Verb
from pa_console.schema.plan import Plan
from tests.llm.site import KINDS, WORLD, picture

BYTES = LLTokenizer("byte")
TOO_LONG = "x" * (REASON_CHARS + 1)
PLAIN = "".join(chr(code) for code in range(32, 127) if chr(code) not in '"\\')


def accepts(grammar: str, text: str) -> bool:
    matcher = LLMatcher(BYTES, grammar)
    tokens = BYTES.tokenize_str(text)
    return matcher.try_consume_tokens(tokens) == len(tokens) and matcher.is_accepting()


def commands(agent: str) -> list[str]:
    """Return every command that `agent` may be given."""
    return [
        command
        for verb, spec in COMMANDS.items()
        if KINDS[agent] in spec.kinds
        for command in (
            [f"{verb} {frame}" for frame in WORLD.frames] if spec.takes_frame else [verb]
        )
    ]


@st.composite
def plans(draw: st.DrawFn) -> dict[str, Any]:
    agents = draw(st.lists(st.sampled_from(sorted(KINDS)), unique=True, min_size=1))
    actions = [{"agent": a, "command": draw(st.sampled_from(commands(a)))} for a in agents]
    reason = draw(st.text(PLAIN, min_size=1, max_size=REASON_CHARS))
    return {"reason": reason, "actions": actions}


@given(plans())
def test_every_plan_of_the_vocabulary_is_writable_and_reads_back(plan: dict[str, Any]):
    text = json.dumps(plan)
    assert accepts(plan_grammar(WORLD, picture()), text)
    assert json.loads(Plan.model_validate_json(text).model_dump_json()) == plan


@given(plans(), st.integers(0, 3), st.integers(0, 3))
def test_no_agent_is_addressed_twice(plan: dict[str, Any], chosen: int, place: int):
    actions = plan["actions"]
    actions.insert(place % (len(actions) + 1), actions[chosen % len(actions)])
    assert not accepts(plan_grammar(WORLD, picture()), json.dumps(plan))


@given(plans(), st.sampled_from(sorted(KINDS)))
def test_an_asset_that_is_down_is_not_addressed(plan: dict[str, Any], down: str):
    addressed = down in [action["agent"] for action in plan["actions"]]
    grammar = plan_grammar(WORLD, picture(down=(down,)))
    assert accepts(grammar, json.dumps(plan)) is not addressed


@pytest.mark.parametrize(
    "action",
    [
        {"agent": "Hawk_1", "command": "block RiverGate"},
        {"agent": "Mule_1", "command": "warn RiverGate"},
        {"agent": "Guard_1", "command": "observe RiverGate"},
        {"agent": "Hawk_1", "command": "move_to Elsewhere"},
        {"agent": "Hawk_1", "command": "move_to"},
        {"agent": "Hawk_1", "command": "hold RiverGate"},
        {"agent": "Hawk_1", "command": "engage RiverGate"},
        {"agent": "Hawk_9", "command": "hold"},
    ],
)
def test_what_is_not_in_the_vocabulary_is_not_writable(action: dict[str, str]):
    plan = {"reason": "because", "actions": [action]}
    assert not accepts(plan_grammar(WORLD, picture()), json.dumps(plan))


@pytest.mark.parametrize(
    "text",
    [
        '{"reason": "none", "actions": []}',
        '{"reason": "", "actions": [{"agent": "Hawk_1", "command": "hold"}]}',
        '{"actions": [{"agent": "Hawk_1", "command": "hold"}], "reason": "late"}',
        '{"reason": "a\\nb", "actions": [{"agent": "Hawk_1", "command": "hold"}]}',
        '{"reason": "%s", "actions": [{"agent": "Hawk_1", "command": "hold"}]}'
        % ("x" * (REASON_CHARS + 1)),
        '{"reason": "two", "actions": [{"agent": "Hawk_1", "command": "hold"}]}, {}',
    ],
)
def test_the_shape_is_bounded(text: str):
    assert not accepts(plan_grammar(WORLD, picture()), text)


def test_with_every_asset_down_the_only_plan_has_no_actions():
    grammar = plan_grammar(WORLD, picture(down=tuple(KINDS)))
    assert accepts(grammar, '{"reason": "all assets are down", "actions": []}')


def test_the_same_arguments_give_the_same_text():
    assert plan_grammar(WORLD, picture()) == plan_grammar(WORLD, picture())


@given(
    st.lists(st.sampled_from(["ROE-01", "WF-03", "CAP-10"]), unique=True),
    st.sampled_from(["Success", "Failure"]),
    st.text(PLAIN, min_size=1, max_size=240),
    st.data(),
)
def test_every_verdict_on_the_given_rules_is_writable_and_reads_back(
    ids: list[str], overall: str, feedback: str, data: st.DataObject
):
    opinions = st.sampled_from(["complies", "violates", "unclear"])
    answer = {
        "rules": [{"id": rule_id, "verdict": data.draw(opinions)} for rule_id in ids],
        "feedback": feedback,
        "verdict": overall,
    }
    assert accepts(judge_grammar(ids), json.dumps(answer))
    verdict, error = read_verdict(json.dumps(answer))
    assert verdict is not None, error
    assert [rule.rule_id for rule in verdict.rules] == ids
    assert (verdict.verdict, verdict.feedback) == (overall, feedback)


def test_a_verdict_on_other_rules_is_not_writable():
    answer = {
        "rules": [{"id": "WF-03", "verdict": "complies"}],
        "feedback": "fine",
        "verdict": "Success",
    }
    assert accepts(judge_grammar(["WF-03"]), json.dumps(answer))
    assert not accepts(judge_grammar(["WF-04"]), json.dumps(answer))
    assert not accepts(judge_grammar(["WF-03", "WF-04"]), json.dumps(answer))


@given(plans())
def test_only_the_chosen_agents_and_frames_are_writable(plan: dict[str, Any]):
    grammar = plan_grammar(WORLD, picture(), ("Hawk_1", "Guard_1"), ("HillGate",))
    chosen = all(
        action["agent"] in ("Hawk_1", "Guard_1")
        and action["command"].split()[1:] in ([], ["HillGate"])
        for action in plan["actions"]
    )
    assert accepts(grammar, json.dumps(plan)) is chosen


VERBS: tuple[Verb, ...] = tuple(COMMANDS)


@given(plans(), st.sets(st.sampled_from(VERBS), min_size=1))
def test_only_the_verbs_of_a_phase_are_writable(plan: dict[str, Any], verbs: set[Verb]):
    within = all(action["command"].split()[0] in verbs for action in plan["actions"])
    assert accepts(plan_grammar(WORLD, picture(), verbs=verbs), json.dumps(plan)) is within


def test_nobody_is_addressed_who_can_carry_out_none_of_the_verbs():
    grammar = plan_grammar(WORLD, picture(), verbs=("observe",))
    assert "Hawk_1" in grammar
    assert "Mule_1" not in grammar
    assert "Guard_1" not in grammar
    nobody = plan_grammar(WORLD, picture(down=("Hawk_1", "Hawk_2")), verbs=("observe",))
    assert accepts(nobody, '{"reason": "no drone is up", "actions": []}')
    assert plan_grammar(WORLD, picture(), verbs=()) == plan_grammar(WORLD, picture())


@given(
    st.lists(st.sampled_from(["ROE-01", "WF-03", "CAP-10"]), unique=True),
    st.sampled_from(["Success", "Failure"]),
    st.text(PLAIN, min_size=1, max_size=240),
)
def test_every_short_verdict_is_writable_and_says_something_of_every_rule(
    violated: list[str], overall: str, feedback: str
):
    answer = {"feedback": feedback, "violated": violated, "verdict": overall}
    rules = ["ROE-01", "WF-03", "CAP-10"]
    assert accepts(compact_judge_grammar(rules), json.dumps(answer))
    verdict, error = read_verdict(json.dumps(answer), rules)
    assert verdict is not None, error
    opinions = {rule.rule_id: rule.opinion for rule in verdict.rules}
    assert opinions == {r: "violates" if r in violated else "complies" for r in rules}
    assert (verdict.verdict, verdict.feedback) == (overall, feedback)


def test_a_short_verdict_names_no_rule_that_was_not_given():
    answer = json.dumps({"feedback": "no", "violated": ["WF-03"], "verdict": "Failure"})
    assert accepts(compact_judge_grammar(["WF-03"]), answer)
    assert not accepts(compact_judge_grammar(["WF-04"]), answer)
    assert not accepts(compact_judge_grammar([]), answer)


GRAMMAR = 'start: "go " ("north" | "south" | "norm" | "base") (" now" | " soon")'
PLACES, TIMES = ("north", "south", "norm", "base"), ("now", "soon")
WAYS = [f"go {place} {time}" for place in PLACES for time in TIMES]


@settings(deadline=None)
@given(st.sampled_from(WAYS), st.integers(0, 2**32 - 1), st.integers(0, 6), st.integers(1, 12))
def test_every_branch_is_another_way_to_begin(text: str, seed: int, begun: int, count: int) -> None:
    answer = BYTES.tokenize_str(text)
    rows = np.random.default_rng(seed).normal(size=(len(answer), BYTES.vocab_size))
    found = branch_points(
        LLMatcher(BYTES, GRAMMAR), BYTES, answer, rows.astype(np.float32), begun, count
    )
    assert len(found) <= count
    assert [branch.chance for branch in found] == sorted((b.chance for b in found), reverse=True)
    begins = [text[: branch.kept] + BYTES.decode_str([branch.token]) for branch in found]
    assert len(set(begins)) == len(begins)
    for branch, begin in zip(found, begins, strict=True):
        assert branch.kept >= begun
        assert not text.startswith(begin)
        assert any(way.startswith(begin) for way in WAYS)


def test_the_likeliest_way_comes_first() -> None:
    answer = BYTES.tokenize_str("go north now")
    rows = np.full((len(answer), BYTES.vocab_size), -9.0, np.float32)
    (norm,), (south,) = BYTES.tokenize_str("m"), BYTES.tokenize_str("s")
    for row, token in zip(rows, answer, strict=True):
        row[token] = 9.0
    rows[3, south], rows[6, norm] = 4.0, 6.0
    found = branch_points(LLMatcher(BYTES, GRAMMAR), BYTES, answer, rows, 0, 2)
    assert [(branch.kept, branch.token) for branch in found] == [(6, norm), (3, south)]
    later = branch_points(LLMatcher(BYTES, GRAMMAR), BYTES, answer, rows, 4, 2)
    assert [(branch.kept, branch.token) for branch in later][:1] == [(6, norm)]
