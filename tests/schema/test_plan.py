"""A plan is read strictly: what the vocabulary does not allow is refused, never dropped."""

import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import BaseModel, ValidationError

from pa_console.schema.command import COMMANDS
from pa_console.schema.events.event import Event, Payload
from pa_console.schema.plan import MAX_ACTIONS, MAX_REASON, Plan
from tests.schema.strategies import FRAMES, PAYLOADS, TEXT, events, models
from tests.session.story import START

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


def made(*after: tuple[int, ...], agents: str = "") -> Plan:
    """Return a plan of holds, each after the actions of those numbers."""
    actions = [
        {"agent": agents[at] if agents else f"A{at}", "command": "hold", "after": list(numbers)}
        for at, numbers in enumerate(after)
    ]
    return Plan.model_validate_json(json.dumps({"reason": "r", "actions": actions}))


def test_a_plan_without_steps_is_written_as_before() -> None:
    text = '{"reason": "r", "actions": [{"agent": "A", "command": "hold"}]}'
    assert Plan.model_validate_json(text).answer == text


def test_actions_are_sent_after_all_that_they_wait_for() -> None:
    plan = made((), (1,), (), (2, 3))
    assert plan.steps == ((1, 3), (2,), (4,))
    assert plan.depends_on([1]) == {1, 2, 4}
    assert plan.part((4,)).actions[0].after == ()


def test_a_plan_in_steps_is_read_as_it_was_written() -> None:
    plan = made((), (1,))
    assert '"after": [1]' in plan.answer
    assert Plan.model_validate_json(plan.answer) == plan


@pytest.mark.parametrize(
    ("after", "told"),
    [
        (((2,), (1,)), "wait for each other in a circle"),
        (((1,),), "wait for each other in a circle"),
        (((), (7,)), "action 2 (A1 hold) waits for action 7, and the plan has actions 1 to 2"),
        (((), (0,)), "waits for action 0"),
    ],
)
def test_what_is_no_order_of_steps_is_told(after: tuple[tuple[int, ...], ...], told: str) -> None:
    with pytest.raises(ValidationError) as refused:
        made(*after)
    assert told in str(refused.value)


@pytest.mark.parametrize("payload", PAYLOADS, ids=lambda model: model.__name__)
def test_every_payload_comes_back_as_it_went_out(payload: type[BaseModel]) -> None:
    @given(models(payload))
    @settings(max_examples=10, deadline=None)
    def check(data: BaseModel) -> None:
        event = Event.model_validate({"t": START, "tick": 1, "data": data})
        back = Event.model_validate_json(event.model_dump_json())
        assert back == event
        assert type(back.data) is payload

    check()


def test_every_payload_has_a_kind_of_its_own() -> None:
    kinds = [payload.model_fields["kind"].default for payload in PAYLOADS]
    assert len(set(kinds)) == len(kinds)
    assert set(PAYLOADS) == set(Payload.__subclasses__())


@given(events(), st.sampled_from(["t", "tick", "data"]))
@settings(max_examples=30, deadline=None)
def test_an_event_with_a_field_missing_or_unknown_is_refused(event: Event, field: str) -> None:
    fields = event.model_dump()
    with pytest.raises(ValidationError):
        Event.model_validate({**fields, "more": 1})
    del fields[field]
    with pytest.raises(ValidationError):
        Event.model_validate(fields)


def test_an_unknown_kind_is_refused() -> None:
    with pytest.raises(ValidationError, match="explosion"):
        Event.model_validate({"t": START, "tick": 1, "data": {"kind": "explosion"}})


@given(events())
@settings(max_examples=20, deadline=None)
def test_an_event_cannot_be_changed(event: Event) -> None:
    with pytest.raises(ValidationError, match="frozen"):
        event.tick = 5
