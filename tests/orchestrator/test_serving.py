"""From what was understood of an order the console knows the commands that serve it."""

import pytest

from pa_console.llm.reading import read_asked
from pa_console.llm.slot_grammar import Slot, slot_grammar
from pa_console.orchestrator.fulfilment import gaps
from pa_console.orchestrator.plan_moves import PlanMoves
from pa_console.orchestrator.serving import serving_slots
from pa_console.policy.rulebook import load_rules
from pa_console.resources import data_folder
from pa_console.schema.incident import FailAsset, Incident, PlaceAsset, SpawnTrack
from pa_console.schema.plan import Action, Plan
from pa_console.training.asked import asked
from pa_console.training.planner_data import Recipe, make_group
from pa_console.training.situations import settled
from pa_console.training.worlds import shipped_world
from tests.llm.test_grammar import accepts
from tests.orchestrator.conftest import Rig
from tests.scripted import ScriptedEngine, plan

WORLD = shipped_world()
FREE = ("Drone_T04", "Ugv_T02", "Robot_T01", "Robot_T02")
CAR = (SpawnTrack(gate="EastGate", distance_m=12.0),)


def slots(words: str, setup: tuple[Incident, ...] = ()) -> list[str]:
    """Return the commands for an order understood as `words`, each with who may have it."""
    reading = read_asked(f"asked: {words}")
    assert reading is not None
    found = serving_slots(reading, WORLD, settled(WORLD, setup=setup).picture)
    return [f"{'|'.join(slot.agents)} {slot.command}" for slot in found]


@pytest.mark.parametrize(
    ("words", "commands"),
    [
        ("Robot_T01 home", ["Robot_T01 return_to_base"]),
        ("1 drone to EastGate", ["Drone_T04 move_to EastGate"]),
        ("1 robot to EastGate", ["Robot_T01|Robot_T02 move_to EastGate"]),
        ("look at WestGate", ["Drone_T01|Drone_T04 observe WestGate"]),
        (
            "Drone_T01 to EastGate",
            [
                "Drone_T04|Ugv_T02 move_to WestGate",
                "Drone_T01 move_to EastGate",
            ],
        ),
        (
            "swap Drone_T04 and Drone_T02",
            ["Drone_T04 move_to NorthGate", "Drone_T02 move_to Checkpoint"],
        ),
        (
            "swap Robot_T01 and Ugv_T01",
            [
                "Drone_T04|Ugv_T02|Robot_T02 move_to EastGate",
                "Robot_T01 move_to EastGate",
                "Ugv_T01 move_to Checkpoint",
            ],
        ),
        ("report by 1 robot", ["Robot_T01|Robot_T02 report"]),
        ("report by all at WestGate", ["Drone_T01 report"]),
        ("report by all robots", ["Robot_T01 report", "Robot_T02 report"]),
        (
            "report; Drone_T03 hold; 1 robot to EastGate",
            [
                "Drone_T03 hold",
                "Robot_T01|Robot_T02 move_to EastGate",
                *(f"{n} report" for n in ("Drone_T01", "Drone_T02", "Drone_T04")),
                *("Ugv_T01 report", "Ugv_T02 report", "Robot_T01|Robot_T02 report"),
            ],
        ),
        ("Drone_T03 hold", ["Drone_T03 hold"]),
        (
            "1 robot identify vehicle at EastGate; 1 drone to WestGate",
            ["Drone_T04 move_to WestGate"],
        ),
        ("1 robot warn at WestGate", ["Drone_T01|Drone_T04 observe WestGate"]),
        (
            "report by all drones; unknown vehicle at EastGate",
            ["Drone_T04 observe EastGate", *(f"Drone_T0{n} report" for n in (1, 2, 3))],
        ),
    ],
)
def test_commands_serve_what_was_understood(words: str, commands: list[str]) -> None:
    assert slots(words) == commands


@pytest.mark.parametrize(
    "words", ["Drone_T09 to EastGate", "1 drone to unknown place", "Drone_T01 to WestGate"]
)
def test_where_nothing_can_be_done_somebody_holds(words: str) -> None:
    (only,) = slots(words)
    assert only.endswith(" hold")


@pytest.mark.parametrize(
    ("words", "setup"),
    [
        ("1 robot warn at EastGate", CAR),
        ("unknown vehicle at EastGate", CAR),
        ("block EastGate", CAR),
        ("Drone_T01 to EastGate; others stay", ()),
        ("Drone_T04 to EastGate; Drone_T04 to WestGate", ()),
        ("Drone_T01 to EastGate", tuple(FailAsset(asset=name) for name in FREE)),
    ],
)
def test_what_depends_on_more_is_left_to_the_planner(
    words: str, setup: tuple[Incident, ...]
) -> None:
    assert slots(words, setup) == []


def test_only_those_come_who_are_to_come_from_there() -> None:
    elsewhere = (PlaceAsset(asset="Robot_T02", frame="NorthGate"),)
    assert slots("1 robot from NorthGate to EastGate", elsewhere) == ["Robot_T02 move_to EastGate"]
    beside = (PlaceAsset(asset="Drone_T04", frame="EastGate"),)
    (only,) = slots("1 drone from Checkpoint look at WestGate", beside)
    assert only.endswith(" hold")
    assert slots("1 drone from EastGate look at WestGate", beside) == ["Drone_T04 observe WestGate"]


def test_where_who_could_relieve_stands_already_the_guard_goes_home() -> None:
    beside = (PlaceAsset(asset="Drone_T04", frame="EastGate"),)
    words = "1 drone relieves Ugv_T01 at EastGate"
    assert slots(words, beside) == ["Ugv_T01 return_to_base"]


def test_nobody_takes_over_a_gate_whose_gate_would_then_be_left() -> None:
    two_each = (
        PlaceAsset(asset="Ugv_T02", frame="NorthGate"),
        PlaceAsset(asset="Drone_T04", frame="NorthGate"),
        *(FailAsset(asset=name) for name in ("Drone_T02", "Robot_T01", "Robot_T02")),
    )
    assert slots("Drone_T01 to EastGate", two_each)[0] == "Drone_T04|Ugv_T02 move_to WestGate"
    words = "Drone_T01 to EastGate; Ugv_T02 to EastGate"
    assert slots(words, two_each) == []


def test_a_drone_looks_before_a_robot_identifies() -> None:
    assert slots("identify at EastGate", CAR) == [
        "Drone_T04 observe EastGate",
        "Robot_T01|Robot_T02 identify EastGate",
    ]


@pytest.mark.parametrize("number", range(4))
def test_a_plan_of_such_commands_is_what_was_asked_and_like_a_proven_one(number: int) -> None:
    rulebook = load_rules(data_folder() / "rules" / "checkpoint.yaml")
    group = make_group(Recipe(number, 31, 6), rulebook, frozenset())
    now = group.situation
    unlike = 0
    for proven in group.proven:
        words = asked(proven.order, now.world, now.picture, now.digest)
        reading = read_asked(f"asked: {words}")
        assert reading is not None
        chosen: dict[str, str] = {}
        for slot in serving_slots(reading, now.world, now.picture):
            chosen[next(name for name in slot.agents if name not in chosen)] = slot.command
        if chosen:
            actions = tuple(Action(agent=name, command=said) for name, said in chosen.items())
            made = Plan(reason="r", actions=actions)
            assert gaps(PlanMoves(now.world, now.picture, made), reading) == ()
            unlike += {*chosen.values()} != {a.command for a in proven.plan.actions}
    assert unlike <= 1


def test_the_grammar_gives_every_command_to_somebody_and_nobody_two() -> None:
    grammar = slot_grammar(
        [Slot(("A", "B"), "move_to Gate"), Slot(("A", "B", "C"), "report")], ["asked: [a-z ]{0,20}"]
    )
    going, told = ("A", "move_to Gate"), ("B", "report")
    assert accepts(grammar, plan(going, told, reason="asked: a b"))
    assert accepts(grammar, plan(("B", "move_to Gate"), ("C", "report"), reason="asked: "))
    assert not accepts(grammar, plan(going, ("A", "report"), reason="asked: a b"))
    assert not accepts(grammar, plan(going, reason="asked: a b"))
    assert not accepts(grammar, plan(told, going, reason="asked: a b"))
    assert not accepts(grammar, plan(going, told, reason="a b"))


async def test_when_no_answer_is_what_was_asked_the_commands_are_given(rig: Rig) -> None:
    asked_so = "asked: 1 drone to EastGate; Free drone: Drone_T04"
    astray = plan(("Drone_T04", "move_to WestGate"), reason=asked_so)
    served = plan(("Drone_T04", "move_to EastGate"), reason=asked_so)
    engine = ScriptedEngine([astray, served], others=[plan(("Drone_T04", "report"))])
    trace = await rig.run(engine)
    assert trace.status == "verified"
    proposed = [e.data for e in rig.events if e.data.kind == "plan_proposed"]
    assert [p.text for p in proposed][-1] == served
    assert [p.given for p in proposed] == [False, False, True]
    assert accepts(engine.requests[1].grammar, served)
    assert not accepts(engine.requests[1].grammar, astray)
