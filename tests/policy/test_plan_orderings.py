"""A plan is judged by what its rehearsal breaks on top of the mission so far, and by no more."""

from datetime import UTC, datetime
from typing import Any

import pytest

from pa_console.policy.authoring.examples import (
    WORLD,
    example_moments,
    example_plan,
    example_rehearsal,
)
from pa_console.policy.monitor import Monitor
from pa_console.policy.rule_checks import check_plan
from pa_console.schema.finding import Finding
from pa_console.schema.mission import Mission
from pa_console.schema.rehearsal import Moment, Rehearsal
from pa_console.schema.rule import RuleExample
from tests.policy.book import checkpoint_rules

MISSION = Mission(id="M1", text="Watch.", created=datetime(2026, 1, 1, tzinfo=UTC))
PLAN = example_plan(RuleExample(name="p", expect="pass", plan=(("Drone_T04", "hold"),)))
UNKNOWN: dict[str, Any] = {"gate": "WestGate"}
CONTACT: dict[str, Any] = {"tracks": {"V1": {"ground_contact": True}}}
LOST: dict[str, Any] = {"covered": {"SouthGate": False}}


def story(*changes: dict[str, Any]) -> tuple[Moment, ...]:
    return example_moments(RuleExample(name="m", expect="pass", moments=changes))


def rehearsed(moments: tuple[Moment, ...], after_s: float = 160.0) -> Rehearsal:
    """Return an uneventful rehearsal of PLAN with these moments."""
    rehearsal = example_rehearsal(RuleExample(name="r", expect="pass"), PLAN)
    after = rehearsal.after.model_copy(update={"time_s": after_s})
    return rehearsal.model_copy(update={"moments": moments, "after": after})


def broken(rehearsal: Rehearsal, monitor: Monitor | None = None) -> dict[str, Finding]:
    findings = check_plan(
        checkpoint_rules(),
        plan=PLAN,
        rehearsal=rehearsal,
        mission=MISSION,
        world=WORLD,
        monitor=monitor,
    )
    assert [f.rule_id for f in findings] == [rule.id for rule in checkpoint_rules().rules]
    return {finding.rule_id: finding for finding in findings if finding.broken}


def test_what_the_rehearsal_breaks_is_a_finding_that_names_the_track() -> None:
    found = broken(rehearsed(story({"tracks": {"V1": UNKNOWN}}, CONTACT)))
    assert set(found) == {"WF-02"}
    assert found["WF-02"].blocking
    assert "V1" in found["WF-02"].message


def test_what_is_so_before_the_plan_begins_is_not_its_doing() -> None:
    assert broken(rehearsed(story({"tracks": {"V1": UNKNOWN | {"warned": True}}}, {}))) == {}


def test_the_missions_history_counts() -> None:
    monitor = Monitor(checkpoint_rules(), WORLD)
    seen, later = (
        story({"tracks": {"V1": UNKNOWN | {"observed": True}}}, {})[0],
        story({"tracks": {"V1": UNKNOWN}}, CONTACT),
    )
    assert set(broken(rehearsed(later), monitor)) == {"WF-02"}
    monitor.observe(seen)
    assert broken(rehearsed(later), monitor) == {}


def test_a_rehearsal_leaves_the_missions_history_alone() -> None:
    monitor = Monitor(checkpoint_rules(), WORLD)
    bad = rehearsed(story({"tracks": {"V1": UNKNOWN}}, CONTACT))
    assert broken(bad, monitor) == broken(bad, monitor) != {}


def test_a_gate_that_the_plan_uncovers_until_the_rehearsals_end_has_been_lost_for_too_long() -> (
    None
):
    moments = story({"at": 100.0}, LOST)
    grace_s = WORLD.coverage_grace_s
    assert set(broken(rehearsed(moments, 101.5 + grace_s))) == {"WF-03"}
    assert broken(rehearsed(moments, 101.0 + grace_s)) == {}


def test_a_plan_is_not_blamed_for_a_gate_that_was_lost_before_it() -> None:
    monitor = Monitor(checkpoint_rules(), WORLD)
    for now in story({"at": 80.0}, {"at": 95.0} | LOST):
        monitor.observe(now)
    restoring = story({"at": 100.0} | LOST, {"at": 130.0, "covered": {"SouthGate": True}})
    assert broken(rehearsed(restoring), monitor) == {}


def test_a_rule_that_its_check_and_an_ordering_break_says_both_in_one_finding() -> None:
    plan = example_plan(
        RuleExample(name="p", expect="pass", plan=(("Robot_T01", "warn WestGate"),))
    )
    given: dict[str, Any] = {"tracks": {"V1": UNKNOWN | {"observed": True}}}
    rehearsal = example_rehearsal(RuleExample(name="r", expect="pass", given=given), plan)
    moments = story(
        {"tracks": {"V1": UNKNOWN | {"observed": True}}}, {"tracks": {"V1": {"warned": True}}}
    )
    findings = check_plan(
        checkpoint_rules(),
        plan=plan,
        rehearsal=rehearsal.model_copy(update={"moments": moments}),
        mission=MISSION,
        world=WORLD,
    )
    (found,) = [finding for finding in findings if finding.rule_id == "WF-01"]
    assert found.status == "violates"
    assert "Robot_T01 would warn at WestGate before the track is identified" in found.message
    assert "warned before it was identified: V1" in found.message


@pytest.mark.parametrize("moments", [(), story({"tracks": {"V1": UNKNOWN}})])
def test_without_moments_or_with_one_alone_no_ordering_is_broken(
    moments: tuple[Moment, ...],
) -> None:
    assert broken(rehearsed(moments)) == {}
