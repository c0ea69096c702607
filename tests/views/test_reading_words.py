"""What an order was read as is told in plain words, and every reading in words of its own."""

import re

import pytest

from pa_console.language.canonical.reading import plain_reading
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Usage
from pa_console.schema.plan import Action, Plan
from pa_console.session.mission_fold import apply_to_mission
from pa_console.session.mission_trace import MissionTrace
from pa_console.tui.rows import plain
from pa_console.tui.widgets.trace_pane import sections
from pa_console.views.event_words import orders_in_line, step_lines, when_in_words
from pa_console.views.waiting import plan_in_words, reading_line
from tests.tui import story
from tests.tui.site import RULES
from tests.written import SITUATIONS, given

NAME = re.compile(r"[A-Z][a-z]+(?:_?[A-Z][a-zA-Z]*)?[0-9]*|\b\d+\b")
UNDER = "if Drone_T01 low: Drone_T01 home; 2 vehicles to Junction, else: nothing"
TOLD = "if Drone_T01 is low on battery, send Drone_T01 home and send 2 ground vehicles to Junction"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("1 drone to EastGate", "send 1 drone to EastGate"),
        ("all from WestGate home", "send everybody from WestGate home"),
        ("look at EastGate", "look at EastGate"),
        ("1 robot warn at unknown place", "let 1 ground robot warn whoever is at an unknown place"),
        ("warn at EastGate", "warn whoever is at EastGate"),
        ("1 robot identify person at G", "let 1 ground robot identify the person at G"),
        ("cover EastGate by 1 robot", "let 1 ground robot guard EastGate"),
        ("cover Ugv_T01 at EastGate", "give EastGate a guard for Ugv_T01"),
        ("cover A_1 at G by 1 drone", "let 1 drone guard G for A_1"),
        ("all free robots to EastGate", "send every free ground robot to EastGate"),
        ("A_1, A_2, A_3 hold; others stay", "let A_1, A_2 and A_3 stay put; all others stay"),
        ("set rules aside, block EastGate", "close the lane at EastGate (setting rules aside)"),
        ("warn at G without identification", "warn whoever is at G without identification"),
        ("hold with noncombatants", "stay put (though noncombatants are there)"),
        ("if no asset free: hold, else: report", "if no asset is free, stay put, otherwise report"),
        (UNDER, f"{TOLD}, otherwise do nothing"),
        (f"{UNDER}; now: Drone_T01: low, alone, so", f"{TOLD}, otherwise do nothing"),
        (f"{UNDER}; now: x, not so; others stay", f"{TOLD}, otherwise do nothing; all others stay"),
        ("something that nobody taught", "something that nobody taught"),
    ],
)  # fmt: skip
def test_a_reading_is_told_in_plain_words(words: str, told: str) -> None:
    assert plain_reading(f"asked: {words}") == told


@pytest.mark.parametrize("number", range(0, SITUATIONS, 4))
def test_every_name_and_number_is_told_and_how_a_condition_stands_is_not(number: int) -> None:
    for one in given(number).orders:
        told = plain_reading(one.order.asked)
        assert sorted(NAME.findall(told)) == sorted(NAME.findall(one.meaning))
        assert not re.search(r"; now:|else:|^if [^,]+:|stand down|asked", told)


@pytest.mark.parametrize("number", range(0, SITUATIONS, 4))
def test_readings_that_differ_are_told_apart(number: int) -> None:
    readings = {one.order.asked for one in given(number).orders}
    assert len({plain_reading(asked) for asked in readings}) == len(readings)


def drafted(**changes: object) -> MissionTrace:
    """Return the trace of a story up to its request for approval, which has `changes`."""
    trace = MissionTrace(story.MISSION)
    for payload in story.told("approval"):
        changed = changes if isinstance(payload, ev.ApprovalRequested) else {}
        apply_to_mission(trace, payload.model_copy(update=changed))
    return trace


@pytest.mark.parametrize(
    ("orders", "words"),
    [
        ([("Drone_T04", "move_to EastGate")], "Drone_T04 to East Gate"),
        ([("Drone_T04", "observe EastGate")], "Drone_T04 to East Gate, observes"),
        (
            [("Drone_T01", "return_to_base"), ("Drone_T02", "return_to_base")],
            "Drone_T01 and Drone_T02 to Base",
        ),
        (
            [("Drone_T01", "hold"), ("Robot_T01", "report"), ("Ugv_T01", "block NorthGate")],
            "Drone_T01 stays, Robot_T01 reports, Ugv_T01 to North Gate, blocks",
        ),
        ([], "no asset moves"),
    ],
)
def test_a_plan_is_told_by_who_goes_where(orders: list[tuple[str, str]], words: str) -> None:
    actions = tuple(Action(agent=agent, command=command) for agent, command in orders)
    assert plan_in_words(Plan(reason="", actions=actions), "Base") == words


def test_the_line_is_a_reading_and_never_an_approval() -> None:
    line = reading_line(drafted(), "Base")
    assert line.startswith("reads as: ")
    assert "approve" not in line.lower()


def test_a_blocked_plan_tells_what_blocks_it_and_nothing_of_gates() -> None:
    trace = drafted(state="blocked", blocked_by=("WF-03: a gate is left without cover",))
    line = reading_line(trace, "Base")
    assert line.endswith("blocked: WF-03: a gate is left without cover")


def test_what_is_missing_is_told_in_place_of_a_reading() -> None:
    trace = drafted(state="not_understood", blocked_by=("not understood: which gate?",))
    assert reading_line(trace, "Base") == "not clear yet: which gate?"


def test_a_draft_that_came_to_nothing_says_nothing() -> None:
    assert reading_line(MissionTrace(story.MISSION), "Base") == ""


def test_a_trace_tells_how_much_came_before_enter() -> None:
    trace = drafted()
    trace.attempts[-1].judge_usage = Usage(completion_tokens=9, seconds=2.0, ahead_s=1.5)
    assert "2.0 s (1.5 s before Enter)" in plain(sections(trace, {rule.id: rule for rule in RULES}))


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
