"""Size changes nothing: what is decided at a large checkpoint is what a small one would get."""

from datetime import UTC, datetime

import pytest

from pa_console.policy.expressions.expression import PLAN_VARIABLES
from pa_console.policy.rule_checks import check_plan
from pa_console.policy.rule_variables import plan_variables
from pa_console.schema.mission import Mission
from tests.policy.book import checkpoint_rules
from tests.policy.large import large_plan, large_rehearsal, large_world

MISSION = Mission(id="M1", text="Identify it.", created=datetime(2026, 1, 1, tzinfo=UTC))


@pytest.mark.parametrize(("assets", "gates", "tracks"), [(30, 4, 2), (1000, 50, 50)])
def test_every_rule_is_decided_alike_at_any_size(assets: int, gates: int, tracks: int) -> None:
    world = large_world(assets, gates)
    plan = large_plan(world)
    rehearsal = large_rehearsal(world, plan, tracks=tracks, moments=20)
    findings = check_plan(
        checkpoint_rules(), plan=plan, rehearsal=rehearsal, mission=MISSION, world=world
    )
    assert {f.rule_id for f in findings if f.broken} == {"WF-02"}
    assert not any(finding.status == "error" for finding in findings)


def test_only_what_is_asked_for_is_converted_and_it_is_the_same_then() -> None:
    world = large_world(12, 4)
    plan = large_plan(world)
    rehearsal = large_rehearsal(world, plan, tracks=3, moments=0)
    whole = plan_variables(plan, rehearsal, MISSION, world)
    assert set(whole) == PLAN_VARIABLES
    for name in PLAN_VARIABLES:
        assert plan_variables(plan, rehearsal, MISSION, world, {name: None}) == {name: whole[name]}
