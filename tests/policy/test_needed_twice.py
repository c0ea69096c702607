"""One asset in several actions of a plan: one after the other it may, at once it may not."""

import json

import pytest

from pa_console.fleets.simulated import SimulatedFleet
from pa_console.policy.findings import problems
from pa_console.schema.plan import Plan
from tests.shipped import home


@pytest.mark.parametrize(
    ("after", "told"),
    [
        (((), (), ()), "Drone_T04 has 2 commands, at most one is allowed"),
        (((), (1,), (1,)), ""),
        (((), (), (2,)), "Drone_T04 is needed twice at once, by actions 1 and 3"),
    ],
)
def test_an_asset_is_needed_once_at_a_time(after: tuple[tuple[int, ...], ...], told: str) -> None:
    orders = (("Drone_T04", "hold"), ("Robot_T01", "hold"), ("Drone_T04", "return_to_base"))
    actions = [
        {"agent": agent, "command": command, "after": list(numbers)}
        for (agent, command), numbers in zip(orders, after, strict=True)
    ]
    plan = Plan.model_validate_json(json.dumps({"reason": "r", "actions": actions}))
    fleet = SimulatedFleet.start(home())
    found = problems(plan, fleet.world, fleet.picture())
    assert [told in one.message for one in found] == [True] * bool(told)
