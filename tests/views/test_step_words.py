"""A plan in steps, in words: each line says what it waits for, the legs of one asset are one."""

import pytest

from pa_console.schema.plan import Action, Plan
from pa_console.views.event_words import orders_in_line, step_lines, when_in_words
from pa_console.views.waiting import plan_in_words


def in_order(*orders: tuple[str, str]) -> Plan:
    """Return a plan in which each action comes after the one before."""
    actions = (
        Action(agent=agent, command=command, after=(number,) if number else ())
        for number, (agent, command) in enumerate(orders)
    )
    return Plan(reason="r", actions=tuple(actions))


TWO = in_order(("Robot_T01", "move_to NorthGate"), ("Drone_T02", "return_to_base"))


def test_a_step_says_what_it_waits_for() -> None:
    first, second = step_lines(TWO)
    assert (first.numbers, first.when) == ("1", "")
    assert (second.numbers, second.does) == ("2", "returns to base")
    assert second.when == "then, after Robot_T01 is at North Gate"
    assert orders_in_line(TWO) == "Robot_T01 move_to NorthGate; then Drone_T02 return_to_base"
    assert plan_in_words(TWO, "Base") == "Robot_T01 to North Gate, then Drone_T02 to Base"


def test_the_legs_of_one_asset_are_one_line() -> None:
    gates = ("WestGate", "NorthGate", "EastGate", "WestGate", "NorthGate", "EastGate")
    patrol = in_order(*(("Drone_T04", f"observe {gate}") for gate in gates))
    (line,) = step_lines(patrol)
    assert (line.numbers, line.agent) == ("1 to 6", "Drone_T04")
    assert line.does.count("→") == 5
    assert plan_in_words(patrol, "Base").endswith("then 2 more steps")


@pytest.mark.parametrize(
    ("command", "told"),
    [
        ("return_to_base", "is at the base"),
        ("hold", "holds"),
        ("report", "has reported"),
        ("identify EastGate", "has identified the track at East Gate"),
        ("warn EastGate", "has warned the track at East Gate"),
        ("block EastGate", "is at East Gate"),
    ],
)
def test_what_is_done_is_told_by_its_command(command: str, told: str) -> None:
    plan = in_order(("A", command), ("B", "hold"))
    assert when_in_words(plan, 2) == f"then, after A {told}"
