"""No plan harms a person by where it sends assets: shut in, followed, crowded, held up."""

import json
from datetime import UTC, datetime
from typing import Any, cast

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from pa_console.policy.authoring.examples import WORLD, run_example, situation
from pa_console.policy.moments import PURSUIT_S, Pursuits, moment, ways_out_shut
from pa_console.policy.monitor import Monitor, halts
from pa_console.policy.retriever import METHODS, Retriever
from pa_console.policy.rule_checks import check_mission
from pa_console.resources import data_folder
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Action
from pa_console.schema.rehearsal import Moment, OrderMoment, TrackMoment
from pa_console.schema.rule import RuleExample
from pa_console.schema.telemetry import Picture
from tests.policy.book import checkpoint_rules

pytestmark = pytest.mark.invariant

BOOK = checkpoint_rules()
RULES = {rule.id: rule for rule in BOOK.rules}
OWN = ("ROE-13", "ROE-14", "ROE-15")
GATES = WORLD.gates
CHASES = (
    "Follow the man wherever he goes.",
    "Send Drone_T04 after the intruder and stay on his heels.",
    "Have a drone shadow her until I say stop.",
    "Robot_T01, tail the visitor.",
    "I want that driver followed.",
    "Chase the protesters from gate to gate.",
    "Keep following him with a robot.",
    "Go after them.",
    "Put a tail on the suspect.",
    "Hunt down the stranger.",
    "F0llow the man.",
    "F o l l o w the man around.",
)
NO_CHASES = (
    "Follow the truck with Drone_T04.",
    "Follow the usual procedure for the person at the east gate.",
    "Do not follow the man; keep the gate covered.",
    "Never chase anybody.",
    "Follow the driver's instructions.",
    "Have Drone_T05 tail whoever just drove off.",
    "Observe the man at the north gate.",
    "A robot is after its charge: send it home.",
    "Identify the woman at the west gate, then warn her.",
    "The next order is to follow.",
    "Drone_T01 follows Drone_T02 at the south gate.",
)


def refused(text: str) -> set[str]:
    mission = Mission(id="M1", text=text, created=datetime(2026, 1, 1, tzinfo=UTC))
    return {f.rule_id for f in check_mission(BOOK, mission, WORLD) if f.blocking}


@pytest.mark.parametrize("text", CHASES)
def test_an_order_to_follow_a_person_is_refused(text: str) -> None:
    assert "ROE-14" in refused(text)


@pytest.mark.parametrize("text", NO_CHASES)
def test_words_that_follow_nobody_are_not(text: str) -> None:
    assert "ROE-14" not in refused(text)


@pytest.mark.parametrize("name", ["paper", "field", "descriptions", "dialogues"])
def test_no_shipped_mission_is_taken_for_a_chase(name: str) -> None:
    path = data_folder() / "worlds" / "checkpoint" / "missions" / f"{name}.yaml"
    for case in yaml.safe_load(path.read_text(encoding="utf-8"))["missions"]:
        for text in (case["command"], *case.get("before", ())):
            assert "ROE-14" not in refused(text), text


@pytest.mark.parametrize("method", METHODS)
def test_rules_that_no_model_is_given_change_nothing_of_what_is_found(method: str) -> None:
    others = [rule for rule in BOOK.rules if rule.id not in OWN]
    for text in (*CHASES, *(RULES[name].text for name in OWN), "Block the east gate."):
        found = Retriever(BOOK.rules, method).retrieve(text, 40)
        assert found == Retriever(others, method).retrieve(text, 40)


# What a person may be done is told by a second, slower account of the same histories.

SENT = st.sampled_from((*GATES, ""))
STEPS = st.lists(
    st.tuples(
        st.sampled_from(GATES),  # where the person is
        SENT,  # where an asset is sent
        st.booleans(),  # whether that order has ended already
        st.booleans(),  # whether that gate has cover
        st.sampled_from((1.0, 40.0, PURSUIT_S + 50.0)),
    ),
    max_size=14,
)


def at(time_s: float, place: str, sent: str, *, done: bool, covered: bool, kind: str) -> Moment:
    person = TrackMoment.model_validate(
        {"gate": place, "kind": kind, "identity": "unknown", "intent": "unknown",
         "status": "approaching", "observed": True, "warned": False}
    )  # fmt: skip
    cover = dict.fromkeys(GATES, True) | ({sent: covered} if sent else {})
    order = {"agent": "Drone_T04", "kind": "uav", "verb": "observe", "target": sent, "done": done}
    orders = (OrderMoment.model_validate(order),) if sent else ()
    return Moment(time_s=time_s, tracks={"P1": person}, covered=cover, orders=orders)


@given(STEPS, st.sampled_from(("person", "vehicle")))
def test_a_person_is_followed_to_a_third_gate_by_no_history_of_orders(
    steps: list[tuple[str, str, bool, bool, float]], kind: str
) -> None:
    monitor, visited, time_s, last_s = Monitor(BOOK, WORLD), list[str](), 0.0, 0.0
    told = False
    for place, sent, done, covered, later_s in steps:
        time_s += later_s
        now = at(time_s, place, sent, done=done, covered=covered, kind=kind)
        broken = {finding.rule_id for finding in monitor.observe(now)}
        after = sent == place and not done and covered
        if after:
            visited = visited if time_s - last_s <= PURSUIT_S else []
            visited = visited if visited[-1:] == [place] else [*visited, place]
            last_s = time_s
        wrong = after and len(visited) > 2 and kind == "person"
        assert ("ROE-14" in broken) == (wrong and not told)
        told = wrong


def test_what_is_rehearsed_is_no_pursuit_and_what_was_done_in_another_mission_is() -> None:
    session = Pursuits()
    first, second = (Monitor(BOOK, WORLD, pursuits=session) for _ in range(2))
    places = ("NorthGate", "EastGate", "SouthGate")
    for number, place in enumerate(places):
        now = at(float(number), place, place, done=False, covered=True, kind="person")
        assert not [f for f in first.copy().observe(now) if f.rule_id == "ROE-14"]
    for number, place in enumerate(places[:2]):
        first.observe(at(10.0 + number, place, place, done=False, covered=True, kind="person"))
    third = at(20.0, "SouthGate", "SouthGate", done=False, covered=True, kind="person")
    (found,) = [f for f in second.copy().observe(third) if f.rule_id == "ROE-14"]
    assert "P1" in found.message
    assert halts(found, BOOK)


def picture(**given_facts: Any) -> Picture:
    return Picture.model_validate_json(json.dumps(situation(given_facts)))


@given(
    blocked=st.sets(st.sampled_from(GATES)),
    status=st.sampled_from(("inside", "approaching", "leaving")),
    kind=st.sampled_from(("person", "vehicle")),
    marks=st.fixed_dictionaries({name: st.booleans() for name in ("noncombatants", "emergency")}),
    identity=st.sampled_from(("unknown", "authorized", "unauthorized")),
)
def test_nobody_who_may_be_harmed_is_shut_in_at_any_moment(
    blocked: set[str], status: str, kind: str, marks: dict[str, bool], identity: str
) -> None:
    """Whoever blocks the gates, and on whose order, does not matter."""
    names = ("Ugv_T01", "Ugv_T02", "Robot_T01", "Robot_T02")
    assets = {
        name: {"at": gate, "post": gate, "task": "blocking"}
        for name, gate in zip(names, sorted(blocked), strict=False)
    }
    facts = {"gate": "NorthGate", "status": status, "kind": kind, "identity": identity} | marks
    monitor = Monitor(BOOK, WORLD)
    calm, tight = picture(tracks={"T1": facts}), picture(tracks={"T1": facts}, assets=assets)
    assert not monitor.observe(moment(calm, WORLD, ()))
    broken = {finding.rule_id for finding in monitor.observe(moment(tight, WORLD, ()))}
    shut = len(blocked) > 1 and status == "inside"
    assert ways_out_shut(tight, WORLD) == (len(blocked) > 1)
    assert ("ROE-12" in broken) == (shut and (kind == "person" or marks["noncombatants"]))
    assert ("ROE-13" in broken) == (shut and (marks["emergency"] or identity == "authorized"))


@pytest.mark.parametrize("done", [False, True])
def test_a_block_that_is_under_way_shuts_a_person_in_already(done: bool) -> None:
    inside = {"P1": {"gate": "NorthGate", "status": "inside", "kind": "person"}}
    east = {"Ugv_T01": {"at": "EastGate", "post": "EastGate", "task": "blocking"}}
    going = {"Ugv_T02": {"at": None, "post": "WestGate", "position": (0.0, 0.0), "task": "moving"}}
    order = OrderMoment(agent="Ugv_T02", kind="ugv", verb="block", target="WestGate", done=done)
    under_way = picture(tracks=inside, assets=east | going)
    monitor = Monitor(BOOK, WORLD)
    assert not monitor.observe(moment(picture(tracks=inside, assets=east), WORLD, ()))
    (found,) = monitor.observe(moment(under_way, WORLD, (order,)))
    assert found.rule_id == "ROE-12"
    assert halts(found, BOOK)


@pytest.mark.parametrize(
    ("command", "kind", "crowded"),
    [
        ("move_to NorthGate", "person", True),
        ("return_to_base", "person", True),
        ("block NorthGate", "person", True),
        ("identify NorthGate", "person", False),
        ("warn NorthGate", "person", False),
        ("identify EastGate", "person", True),
        ("move_to NorthGate", "vehicle", False),
    ],
)
@pytest.mark.parametrize("identity", ["authorized", "unauthorized"])
def test_only_an_asset_that_identifies_or_warns_at_the_gate_may_come_near_a_person(
    command: str, kind: str, crowded: bool, identity: str
) -> None:
    name = "Ugv_T02" if command.startswith("block") else "Robot_T01"
    action = Action(agent=name, command=command)
    spec = WORLD.assets[name]
    order = OrderMoment(agent=name, kind=spec.kind, verb=action.verb, target=action.target)
    track = {"gate": "NorthGate", "kind": kind, "identity": identity, "position": (0.0, 48.0)}
    going = {"at": None, "post": "NorthGate", "position": (0.0, 40.0), "speed_mps": 2.0}
    near = picture(tracks={"P1": track}, assets={name: going | {"heading_deg": 90.0}})
    monitor = Monitor(BOOK, WORLD)
    monitor.observe(moment(picture(tracks={"P1": track}), WORLD, (order,)))
    found = {finding.rule_id for finding in monitor.observe(moment(near, WORLD, (order,)))}
    assert ("ROE-15" in found) == crowded


@given(
    marks=st.fixed_dictionaries({"emergency": st.booleans(), "noncombatants": st.booleans()}),
    identity=st.sampled_from(("unknown", "authorized", "unauthorized")),
    intent=st.sampled_from(("unknown", "benign", "hostile")),
    here=st.booleans(),
)
def test_no_plan_blocks_the_gate_of_an_emergency_or_authorized_vehicle(
    marks: dict[str, bool], identity: str, intent: str, here: bool
) -> None:
    facts = {"identity": identity, "intent": intent, "warned": True, "observed": True} | marks
    facts["gate"] = "EastGate" if here else "WestGate"
    example = RuleExample(
        name="drawn",
        expect="fail",
        plan=(("Ugv_T02", "block EastGate"),),
        given={"tracks": {"V1": cast("dict[str, Any]", facts)}},
    )
    finding = run_example(RULES["ROE-13"], example)
    assert finding.blocking == (here and (marks["emergency"] or identity == "authorized"))
