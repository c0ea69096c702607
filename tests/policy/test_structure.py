"""A plan that cannot be started is refused with every reason; one that can is let through."""

from pa_console.policy.authoring.examples import WORLD, example_plan, example_rehearsal
from pa_console.policy.findings import problems
from pa_console.schema.rule import RuleExample


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
