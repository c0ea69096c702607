"""Plans in steps: what waits for what, what is no order of steps, and how plans are written."""

import json

import pytest
from pydantic import ValidationError

from pa_console.schema.plan import Plan


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
