"""A plan is read strictly: what the vocabulary does not allow is refused, never dropped."""

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from pa_console.schema.command import COMMANDS
from pa_console.schema.plan import MAX_ACTIONS, MAX_REASON, Plan
from tests.schema.strategies import FRAMES, TEXT, models

WORDS = st.text(st.characters(categories=["L", "N"]), min_size=1, max_size=10)


def plan_of(command: str, agent: str = "Drone_T01", **extra: Any) -> str:
    action = {"agent": agent, "command": command, **extra}
    return json.dumps({"reason": "because", "actions": [action]})


@given(models(Plan))
def test_a_plan_comes_back_as_it_went_out(plan: Plan) -> None:
    assert Plan.model_validate_json(plan.model_dump_json()) == plan


@given(models(Plan))
def test_the_two_fields_are_read_in_either_order(plan: Plan) -> None:
    fields = plan.model_dump(mode="json")
    backwards = {key: fields[key] for key in ("actions", "reason")}
    assert Plan.model_validate_json(json.dumps(backwards)) == plan


@given(models(Plan))
def test_the_papers_frame_prefix_means_the_same(plan: Plan) -> None:
    fields = plan.model_dump(mode="json")
    for action in fields["actions"]:
        action["agent"] = "FRAME_" + action["agent"]
        verb, *frame = action["command"].split()
        action["command"] = " ".join([verb, *("FRAME_" + name for name in frame)])
    assert Plan.model_validate_json(json.dumps(fields)) == plan


def test_verb_and_target_are_told_apart() -> None:
    plan = Plan.model_validate_json(plan_of("  observe   FRAME_EastGate "))
    assert (plan.actions[0].verb, plan.actions[0].target) == ("observe", "EastGate")
    plan = Plan.model_validate_json(plan_of("hold"))
    assert (plan.actions[0].verb, plan.actions[0].target) == ("hold", None)


@given(WORDS.filter(lambda word: word not in COMMANDS), st.sampled_from(["", " EastGate"]))
def test_an_unknown_command_is_refused_and_the_known_ones_are_named(verb: str, frame: str) -> None:
    with pytest.raises(ValidationError, match=r"unknown command.*known: hold, move_to"):
        Plan.model_validate_json(plan_of(verb + frame))


@given(st.sampled_from(sorted(COMMANDS)), st.lists(st.sampled_from(FRAMES), max_size=3))
def test_a_command_takes_exactly_the_frames_it_needs(verb: str, frames: list[str]) -> None:
    command = " ".join([verb, *frames])
    needed = int(next(spec.takes_frame for name, spec in COMMANDS.items() if name == verb))
    if len(frames) == needed:
        assert Plan.model_validate_json(plan_of(command)).actions[0].command == command
    else:
        with pytest.raises(ValidationError, match="takes"):
            Plan.model_validate_json(plan_of(command))


@pytest.mark.parametrize("verb", ["Hold", "HOLD", "fire", "engage", "shoot", "move-to", "moveto"])
def test_no_spelling_and_no_force_slips_in(verb: str) -> None:
    with pytest.raises(ValidationError, match="unknown command"):
        Plan.model_validate_json(plan_of(f"{verb} EastGate"))


def test_there_is_no_command_for_force() -> None:
    assert set(COMMANDS) == {
        "hold", "move_to", "observe", "identify", "warn", "block", "return_to_base", "report",
    }  # fmt: skip


@pytest.mark.parametrize(
    "text",
    [
        plan_of("hold", extra="x"),
        plan_of(""),
        plan_of("   "),
        plan_of("hold", agent=""),
        plan_of("hold", agent="x" * 65),
        '{"reason": "r", "actions": [], "more": 1}',
        '{"reason": "r"}',
        '{"actions": []}',
        '{"reason": 1, "actions": []}',
        '{"reason": "r", "actions": null}',
        '{"reason": "r", "actions": {}}',
        '{"reason": "r", "actions": ["hold"]}',
        '{"reason": "r", "actions": [{"agent": "A"}]}',
        '{"reason": "r", "actions": [{"agent": 1, "command": "hold"}]}',
        json.dumps({"reason": "r" * (MAX_REASON + 1), "actions": []}),
        json.dumps(
            {
                "reason": "r",
                "actions": [{"agent": "A", "command": "hold"}] * (MAX_ACTIONS + 1),
            }
        ),
        '{"reason": "r", "actions": [',
        "[]",
        "",
    ],
)
def test_anything_else_is_refused(text: str) -> None:
    with pytest.raises(ValidationError):
        Plan.model_validate_json(text)


@given(TEXT)
def test_any_text_is_a_plan_or_a_refusal(text: str) -> None:
    try:
        plan = Plan.model_validate_json(plan_of(text))
    except ValidationError:
        return
    assert plan.actions[0].verb in COMMANDS
