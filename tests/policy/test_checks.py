"""Checks decide each rule exactly once, never raise, and what they cannot decide blocks."""

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pa_console.fleets.simulated import SimulatedFleet
from pa_console.policy.authoring.examples import WORLD, example_plan, example_rehearsal, run_example
from pa_console.policy.findings import MAX_OFFENDERS, problems
from pa_console.policy.rule_checks import check_mission, check_plan
from pa_console.policy.rulebook import load_rules
from pa_console.schema.finding import Finding
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.rule import RuleExample
from tests.policy.book import checkpoint_rules, write_rules
from tests.policy.situations import plans, rehearsals
from tests.schema.strategies import models
from tests.shipped import home

SLOW_DATA = (HealthCheck.too_slow, HealthCheck.data_too_large)
MISSION = Mission(id="M1", text="Hold.", created=datetime(2026, 1, 1, tzinfo=UTC))
EXAMPLE = RuleExample(
    name="two move",
    expect="pass",
    plan=(("Drone_T04", "observe EastGate"), ("Robot_T02", "return_to_base")),
)


def decide(folder: Path, rule: dict[str, Any], example: RuleExample = EXAMPLE) -> Finding:
    """Return the finding of a rulebook with this one rule."""
    book = load_rules(write_rules(folder, {"message": "this is wrong"} | rule))
    plan = example_plan(example)
    (finding,) = check_plan(
        book,
        plan=plan,
        rehearsal=example_rehearsal(example, plan),
        mission=MISSION,
        world=WORLD,
    )
    return finding


def assert_decided(plan: Plan, rehearsal: Rehearsal, mission: Mission) -> None:
    book = checkpoint_rules()
    findings = check_plan(book, plan=plan, rehearsal=rehearsal, mission=mission, world=WORLD)
    assert [finding.rule_id for finding in findings] == [rule.id for rule in book.rules]
    for rule, finding in zip(book.rules, findings, strict=True):
        assert finding.status != "error", finding
        assert finding.priority == rule.priority
        assert (finding.status == "judged_only") == (not rule.decidable)
        assert bool(finding.message) == (finding.status == "violates")


@settings(max_examples=60, deadline=None, suppress_health_check=SLOW_DATA)
@given(models(Plan), models(Rehearsal), models(Mission))
def test_every_rule_is_decided_once_on_any_values_that_the_schema_allows(
    plan: Plan, rehearsal: Rehearsal, mission: Mission
) -> None:
    assert_decided(plan, rehearsal, mission)


@settings(max_examples=60, deadline=None, suppress_health_check=SLOW_DATA)
@given(st.data())
def test_every_rule_is_decided_once_on_random_plans_at_a_random_checkpoint(
    data: st.DataObject,
) -> None:
    plan = data.draw(plans())
    assert_decided(plan, data.draw(rehearsals(plan)), data.draw(models(Mission)))


@settings(max_examples=100, deadline=None)
@given(st.text(min_size=1, max_size=300))
def test_any_words_are_decided_at_intake(text: str) -> None:
    mission = Mission(id="M1", text=text, created=MISSION.created)
    found = check_mission(checkpoint_rules(), mission, WORLD)
    assert {finding.status for finding in found} <= {"complies", "violates"}


@pytest.mark.parametrize(
    ("check", "status", "message"),
    [
        ("true", "complies", ""),
        ("false", "violates", "this is wrong"),
        ("[]", "complies", ""),
        ("['NorthGate']", "violates", "this is wrong: NorthGate"),
        ("['a', 'b', 'a']", "violates", "this is wrong: a, b"),
        ("actions.map(a, a.agent)", "violates", "this is wrong: Drone_T04, Robot_T02"),
    ],
)
def test_a_check_yields_true_or_false_or_the_offenders(
    tmp_path: Path, check: str, status: str, message: str
) -> None:
    finding = decide(tmp_path, {"check": check})
    assert (finding.status, finding.message) == (status, message)


def test_a_long_list_of_offenders_is_cut_with_their_number(tmp_path: Path) -> None:
    names = [f"asset{number}" for number in range(MAX_OFFENDERS + 3)]
    finding = decide(tmp_path, {"check": str(names)})
    assert finding.message.endswith(f"asset{MAX_OFFENDERS - 1} and 3 more")


@pytest.mark.parametrize(
    "rule",
    [
        {"check": "actions[0].nosuchfield == 1"},
        {"check": "1 / (size(actions) - 2) == 1"},
        {"check": "'a text'"},
        {"check": "[1, 2]"},
        {"check": "null"},
        {"check": "true", "applies": "actions[7].verb == 'hold'"},
        {"check": "true", "applies": "'yes'"},
        {"check": "false", "applies": "size(actions)"},
    ],
)
def test_a_check_that_cannot_decide_is_an_error_and_blocks(
    tmp_path: Path, rule: dict[str, Any]
) -> None:
    finding = decide(tmp_path, rule)
    assert finding.status == "error"
    assert finding.blocking
    assert finding.message.startswith("the check could not decide: ")


def test_a_guard_that_is_false_makes_the_rule_not_applicable(tmp_path: Path) -> None:
    assert decide(tmp_path, {"check": "false", "applies": "false"}).status == "not_applicable"


def test_a_rule_without_a_check_is_left_to_the_judge(tmp_path: Path) -> None:
    finding = decide(tmp_path, {"message": ""})
    assert finding.status == "judged_only"
    assert not finding.broken


def test_a_mission_is_judged_by_its_words_not_by_their_spelling(tmp_path: Path) -> None:
    book = load_rules(
        write_rules(tmp_path, {"check": 'mission.words == "don\'t go"', "message": "no"})
    )
    for text in ("Don't go", " DON’T\n\tgo ", "Ｄon't go", "do\u200bn't go"):
        mission = Mission(id="M1", text=text, created=MISSION.created)
        assert check_mission(book, mission, WORLD)[0].status == "complies", text


@pytest.mark.parametrize(
    ("example", "problem"),
    [
        ({"given": {"weather": "fog"}}, "given.weather is unknown"),
        ({"given": {"assets": {"Drone_T01": {"colour": "red"}}}}, "colour"),
        ({"given": {"tracks": {"V1": {}}}}, "gate"),
        ({"given": {"tracks": 5}}, "cannot be run"),
        ({"plan": (("Drone_T01", "shoot"),)}, "unknown command"),
    ],
)
def test_an_example_that_makes_no_sense_is_an_error_that_says_why(
    example: dict[str, Any], problem: str
) -> None:
    rule = checkpoint_rules().get("WF-03")
    finding = run_example(rule, RuleExample(name="odd", expect="pass", **example))
    assert finding.status == "error"
    assert problem in finding.message


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


def messages(*actions: tuple[str, str]) -> list[str]:
    example = RuleExample(name="structure", expect="pass", plan=actions)
    plan = example_plan(example)
    found = problems(plan, WORLD, example_rehearsal(example, plan).before)
    assert all(finding.blocking for finding in found)
    return [finding.message for finding in found]


def test_a_sound_plan_has_no_problem() -> None:
    assert messages() == []
    assert messages(("Drone_T04", "observe EastGate"), ("Robot_T01", "report")) == []


def test_an_unknown_agent_is_named_with_those_that_exist() -> None:
    (message,) = messages(("Drone_T99", "hold"))
    assert "'Drone_T99'" in message
    assert "Drone_T04" in message


def test_an_unknown_frame_is_named_with_those_that_exist() -> None:
    (message,) = messages(("Drone_T04", "move_to Moon"))
    assert "'Moon'" in message
    assert "EastGate" in message


def test_a_command_for_another_kind_says_who_can() -> None:
    assert messages(("Drone_T04", "warn EastGate")) == ["Drone_T04 is a uav; only a robot can warn"]
    assert messages(("Robot_T01", "block EastGate")) == [
        "Robot_T01 is a robot; only a ugv can block"
    ]


def test_an_agent_that_is_addressed_twice_is_refused_even_with_the_same_command() -> None:
    (message,) = messages(("Drone_T04", "hold"), ("Drone_T04", "hold"))
    assert message == "Drone_T04 has 2 commands, at most one is allowed"


def test_every_problem_is_reported_not_only_the_first() -> None:
    found = messages(("Nobody", "move_to Moon"), ("Ugv_T01", "warn Mars"), ("Ugv_T01", "hold"))
    assert len(found) == 5
