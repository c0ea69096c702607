"""From what was understood of an order the console knows the commands that serve it."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.language.canonical.reading import read_asked
from pa_console.llm.roles.grammar import CommandSlot, slot_grammar
from pa_console.mission.planning.choices import commands_serving
from pa_console.policy.rulebook import Rulebook, load_rules
from pa_console.resources import data_folder
from pa_console.schema.incident import FailAsset, Incident, PlaceAsset, SetBattery, SpawnTrack
from pa_console.schema.plan import Action, Plan
from pa_training.proof.verify import verify
from pa_training.samples.groups import Proven
from pa_training.situations.situations import Situation, settled
from pa_training.situations.worlds import shipped_world
from tests.llm.test_grammar import accepts
from tests.rig import Rig
from tests.scripted import ScriptedEngine, plan
from tests.written import proven

WORLD = shipped_world()
FREE = ("Drone_T04", "Ugv_T02", "Robot_T01", "Robot_T02")
CAR = (SpawnTrack(gate="EastGate", distance_m=12.0),)


def every(words: str, setup: tuple[Incident, ...] = ()) -> list[list[str]]:
    """Return the commands for an order understood as `words`, each with who may have it."""
    reading = read_asked(f"asked: {words}")
    assert reading is not None
    found = commands_serving(reading, WORLD, settled(WORLD, setup=setup).picture)
    return [[f"{'|'.join(slot.agents)} {slot.command}" for slot in slots] for slots in found]


def slots(words: str, setup: tuple[Incident, ...] = ()) -> list[str]:
    """Return the commands that come first."""
    return next(iter(every(words, setup)), list[str]())


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
                *("Ugv_T01 report", "Ugv_T02 report", "Robot_T02|Robot_T01 report"),
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
    ("words", "setup", "commands"),
    [
        (
            "1 robot warn at EastGate",
            CAR,
            ["Drone_T04 observe EastGate", "Robot_T01|Robot_T02 identify EastGate"],
        ),
        ("unknown vehicle at EastGate", CAR, ["Drone_T04 observe EastGate"]),
        ("block EastGate", CAR, ["Drone_T04 observe EastGate"]),
        (
            "block EastGate",
            (*CAR, FailAsset(asset="Drone_T04")),
            ["Drone_T01|Drone_T02|Drone_T03|Ugv_T01|Ugv_T02|Robot_T01|Robot_T02 hold"],
        ),
        (
            "Robot_T01 to EastGate",
            CAR,
            ["Drone_T04 observe EastGate", "Robot_T01 move_to EastGate"],
        ),
    ],
)
def test_whoever_is_there_is_met_in_the_order_of_the_workflow(
    words: str, setup: tuple[Incident, ...], commands: list[str]
) -> None:
    assert slots(words, setup) == commands


@pytest.mark.parametrize(
    ("words", "setup", "commands"),
    [
        ("Drone_T01 to EastGate; Robot_T01 home; others stay", (), ["Robot_T01 return_to_base"]),
        (
            "1 robot to EastGate; 1 drone to WestGate; look at NorthGate",
            (),
            [
                "Robot_T01|Robot_T02 move_to EastGate",
                "Drone_T04 move_to WestGate",
                "Drone_T02 observe NorthGate",
            ],
        ),
        ("1 drone to EastGate; 1 drone to WestGate", (), ["Drone_T04 move_to EastGate"]),
        (
            "1 drone to EastGate; swap Drone_T04 and Drone_T02",
            (),
            [
                "Drone_T04 move_to NorthGate",
                "Drone_T02 move_to Checkpoint",
            ],
        ),
        (
            "1 drone warn at EastGate; Robot_T01 home",
            (),
            ["Drone_T04 observe EastGate", "Robot_T01 return_to_base"],
        ),
        ("unknown vehicle at EastGate; 1 drone to WestGate", (), ["Drone_T04 move_to WestGate"]),
    ],
)
def test_as_much_is_served_as_can_be(
    words: str, setup: tuple[Incident, ...], commands: list[str]
) -> None:
    assert slots(words, setup) == commands


def test_less_and_less_is_offered_and_at_last_that_somebody_holds() -> None:
    offered = every("Drone_T01 to EastGate; Ugv_T01 home")
    assert len(offered[0]) > len(offered[-2]) == 2
    (last,) = offered[-1]
    assert last.endswith(" hold")


def test_those_who_reinforce_a_gate_go_home_and_one_stays() -> None:
    beside = (PlaceAsset(asset="Drone_T04", frame="EastGate"),)
    assert slots("stand down EastGate", beside) == ["Ugv_T01 return_to_base"]
    low = (*beside, SetBattery(asset="Drone_T04", percent=10.0))
    assert slots("stand down EastGate", low) == ["Drone_T04 return_to_base"]
    assert slots("stand down EastGate")[0].endswith(" hold")


def test_another_kind_guards_a_gate_where_none_of_the_kind_is_free() -> None:
    lost = (FailAsset(asset="Drone_T02"), FailAsset(asset="Drone_T04"))
    words = "cover Drone_T02 at NorthGate by 1 drone"
    assert slots(words, lost) == ["Ugv_T02|Robot_T01|Robot_T02 move_to NorthGate"]


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
    assert every(words, two_each)[:2] == [
        ["Drone_T04 move_to WestGate", "Drone_T01 move_to EastGate"],
        ["Ugv_T02 move_to EastGate"],
    ]


def test_a_drone_looks_before_a_robot_identifies() -> None:
    assert slots("identify at EastGate", CAR) == [
        "Drone_T04 observe EastGate",
        "Robot_T01|Robot_T02 identify EastGate",
    ]


KINDS = {"drone": "uav", "vehicle": "ugv", "robot": "robot"}
placed = st.fixed_dictionaries(dict.fromkeys(WORLD.assets, st.sampled_from([*WORLD.frames])))
incidents = st.lists(
    st.builds(FailAsset, asset=st.sampled_from([*WORLD.assets]))
    | st.builds(SetBattery, asset=st.sampled_from([*WORLD.assets]), percent=st.just(15.0)),
    max_size=3,
)


@settings(deadline=None, max_examples=50)
@given(placed, incidents, st.sampled_from([*KINDS]), st.sampled_from([*WORLD.gates]))
def test_nobody_else_moves_where_one_asset_will_do(
    layout: dict[str, str], broken: list[Incident], kind: str, gate: str
) -> None:
    setup = [*(PlaceAsset(asset=name, frame=at) for name, at in layout.items()), *broken]
    picture = settled(WORLD, setup=setup).picture
    alone = {cover.by[0] for cover in picture.gates.values() if len(cover.by) == 1}
    one_will_do = any(
        asset.available
        and not asset.low_battery
        and asset.kind == KINDS[kind]
        and name not in alone
        and asset.post != gate
        for name, asset in picture.assets.items()
    )
    reading = read_asked(f"asked: 1 {kind} to {gate}")
    assert reading is not None
    for given_to in commands_serving(reading, WORLD, picture):
        assert sum(slot.verb not in ("hold", "report") for slot in given_to) <= 1
    first = next(iter(commands_serving(reading, WORLD, picture)))
    assert (first[0].command == f"move_to {gate}") == one_will_do


@pytest.mark.parametrize("number", range(4))
def test_plans_of_such_commands_are_proven_right(number: int) -> None:
    rulebook = load_rules(data_folder() / "rules" / "checkpoint.yaml")
    group = proven(number)
    right = [_is_served(mission, group.situation, rulebook) for mission in group.proven]
    assert right.count(False) <= 1


def _is_served(mission: Proven, now: Situation, rulebook: Rulebook) -> bool:
    """Whether the first plan that nothing blocks does what is due, whoever could be chosen."""
    for slots_given in commands_serving(mission.order.reading, now.world, now.picture):
        chosen: dict[str, str] = {}
        for slot in slots_given:
            chosen[next(name for name in slot.agents if name not in chosen)] = slot.command
        actions = tuple(Action(agent=name, command=said) for name, said in chosen.items())
        made = Plan(reason="r", actions=actions)
        verified = verify(mission.case, now, made, rulebook, follow=mission.target.follow)
        if not verified.checked.examination.blocked or verified.checked.words:
            return verified.right
    return False


def test_the_grammar_gives_every_command_to_somebody_and_nobody_two() -> None:
    grammar = slot_grammar(
        [CommandSlot(("A", "B"), "move_to Gate"), CommandSlot(("A", "B", "C"), "report")],
        ["asked: [a-z ]{0,20}"],
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
