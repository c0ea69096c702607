"""What of an order no plan can do now is told with the reason, and nothing else is."""

import pytest

from pa_console.language.canonical.reading import read_asked
from pa_console.mission.planning.moves import PlanMoves
from pa_console.mission.planning.obstacles import unmet_asks
from pa_console.schema.events import event as ev
from pa_console.schema.incident import FailAsset, Incident, SetBattery
from pa_console.schema.plan import Action, Plan
from pa_console.session.mission_trace import Attempt
from pa_console.views.event_words import event_in_words
from pa_console.views.trace_parts import rows_of
from pa_console.views.trace_planning import plan as section_of
from tests.mission.test_fulfilment import CAR, moves
from tests.written import proven

NO_DRONE = (FailAsset(asset="Drone_T04"),)


def told(
    words: str, *orders: str, setup: tuple[Incident, ...] = (), text: str = "whoever is free"
) -> tuple[str, ...]:
    reading = read_asked(f"asked: {words}")
    assert reading is not None
    return tuple(one.words for one in unmet_asks(moves(*orders, setup=setup), reading, text))


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ("use force at EastGate", "no order may have that"),
        ("1 drone to unknown place", "no such place (CAP-06)"),
        ("Drone_T09 to EastGate", "no asset Drone_T09 (CAP-10)"),
        ("1 vehicle warn at EastGate", "no vehicle can warn"),
        ("Drone_T04 to EastGate", "Drone_T04 is down"),
        ("1 drone to EastGate", "nobody can be spared"),
        ("look at EastGate", "nobody can be spared"),
        ("Ugv_T01 to WestGate", "Ugv_T01 covers EastGate alone"),
        ("Ugv_T01 to EastGate", "Ugv_T01 there already"),
        ("1 vehicle to EastGate", "Ugv_T01 there already"),
    ],
)
def test_what_cannot_be_done_is_told_with_the_reason(words: str, why: str) -> None:
    assert told(words, "Robot_T01 hold", setup=NO_DRONE) == (f"{words}: {why}",)


def test_of_two_asks_for_one_asset_the_other_is_told() -> None:
    words = "1 robot identify vehicle at NorthGate; 1 drone to SouthGate"
    assert told("look at EastGate; 1 drone to WestGate", "Drone_T04 move_to WestGate") == (
        "look at EastGate: nobody can be spared",
    )
    assert told(words, "Drone_T02 observe NorthGate", "Drone_T04 move_to SouthGate") == (
        "1 robot identify vehicle at NorthGate: nobody is in sight there",
    )


def test_the_part_that_cannot_be_done_is_told() -> None:
    low = (SetBattery(asset="Robot_T01", percent=9.0),)
    words, sent = "Robot_T01, Robot_T02 to EastGate", "Robot_T02 move_to EastGate"
    assert told(words, sent, setup=low) == (f"{words}: Robot_T01 is low (CAP-04)",)
    assert told("3 robots to EastGate", "Robot_T01 move_to EastGate", sent) == (
        "3 robots to EastGate: no more than 2 can be spared",
    )


@pytest.mark.parametrize(
    ("words", "orders"),
    [
        ("1 drone to EastGate", ["Drone_T04 move_to EastGate"]),
        ("1 drone to EastGate", ["Drone_T04 hold"]),
        ("1 robot identify vehicle at EastGate", ["Drone_T04 observe EastGate"]),
        ("relieve Ugv_T01 at EastGate",
         ["Drone_T04 move_to EastGate", "Ugv_T01 return_to_base"]),
        ("report; Drone_T03 hold", ["Drone_T01 report"]),
    ],
)  # fmt: skip
def test_of_what_is_done_or_could_be_nothing_is_told(words: str, orders: list[str]) -> None:
    assert told(words, *orders, setup=CAR) == ()


def test_of_all_who_were_asked_for_it_is_told_who_stays_and_why() -> None:
    words = "all drones to EastGate"
    sent = [f"{name} move_to EastGate" for name in ("Drone_T04",)]
    [line] = told(words, *sent, text="Send all drones to the east gate.")
    assert line.startswith(f"{words}: Drone_T0")
    assert "alone (WF-03)" in line
    assert told(words, *sent, text="Send all free drones to the east gate.") == ()


def test_that_nobody_is_there_to_be_met_is_told_however_a_drone_looks() -> None:
    words = "1 robot warn vehicle at WestGate"
    [line] = told(words, "Drone_T04 observe WestGate")
    assert line == f"{words}: nobody is in sight there"


@pytest.mark.parametrize("number", range(3))
def test_of_whole_orders_with_proven_plans_nothing_is_told(number: int) -> None:
    group = proven(number)
    now = group.situation
    for mission in group.proven:
        reading = mission.order.reading
        plan = PlanMoves(now.world, now.picture, mission.plan)
        idle = all(action.verb == "hold" for action in mission.plan.actions)
        if any("in sight" not in one.words for one in unmet_asks(plan, reading, "who is free")):
            assert idle or len(reading.asks) > 1


def test_the_trace_and_the_log_say_it_beside_the_plan() -> None:
    reason, hold = "asked: look at A; free", Action(agent="Drone_T04", command="hold")
    attempt = Attempt(1, plan=Plan(reason=reason, actions=(hold,)), unmet=("look at A: nobody",))
    rows = [
        "".join(span.text for span in (*row.lead, *row.body))
        for row in rows_of(section_of(attempt))
    ]
    assert any(text.split() == ["not", "met", "look", "at", "A:", "nobody"] for text in rows)
    data = ev.PlanChecked(attempt=1, findings=(), seconds=0.0, unmet=attempt.unmet)
    assert event_in_words(data) == "no rule broken; not met: look at A: nobody"
