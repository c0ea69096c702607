"""A moment says of tracks what a mission's own orders do to them, and nothing of other assets."""

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.policy.authoring.examples import (
    WORLD,
    example_plan,
    example_rehearsal,
    run_example,
    situation,
)
from pa_console.policy.moments import distinct, moment
from pa_console.policy.monitor import Monitor
from pa_console.policy.rule_checks import check_plan
from pa_console.policy.rule_variables import KEPT_S, Sightings, TrackSighting
from pa_console.policy.rulebook import load_rules
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Action
from pa_console.schema.rehearsal import Moment, OrderMoment, TrackMoment
from pa_console.schema.rule import RuleExample
from pa_console.schema.telemetry import Picture

WEST = WORLD.frames["WestGate"].at
OUT_5_M = (WEST[0] - 5.0, WEST[1])
AT_GATE: dict[str, Any] = {"at": "WestGate", "position": WEST}
ON_THE_WAY: dict[str, Any] = {"at": None, "post": "WestGate", "position": WEST, "task": "moving"}
TO_THE_WEST: dict[str, Any] = {"speed_mps": 2.0, "heading_deg": 180.0}


def seen(orders: list[OrderMoment], agents: tuple[str, ...] = (), **given_facts: Any) -> Moment:
    picture = Picture.model_validate_json(json.dumps(situation(given_facts)))
    return moment(picture, WORLD, orders, agents)


def order(agent: str, command: str, done: bool = False) -> OrderMoment:
    action = Action(agent=agent, command=command)
    kind = WORLD.assets[agent].kind
    return OrderMoment(agent=agent, kind=kind, verb=action.verb, target=action.target, done=done)


def track_after(command: str, robot: dict[str, Any], **facts: Any) -> TrackMoment:
    """Return V1, 5 m outside of the west gate, while Robot_T01 carries out `command`."""
    track = {"gate": "WestGate", "position": OUT_5_M} | facts
    now = seen([order("Robot_T01", command)], assets={"Robot_T01": robot}, tracks={"V1": track})
    return now.tracks["V1"]


def test_a_moment_keeps_what_is_known_of_tracks_stale_or_not() -> None:
    facts = {
        "identity": "unauthorized", "intent": "hostile", "status": "inside", "observed": True,
        "warned": True, "defiant": True, "noncombatants": True, "gate": "EastGate",
    }  # fmt: skip
    for stale in (False, True):
        now = seen([], tracks={"V1": facts | {"stale": stale}})
        assert now.tracks["V1"] == TrackMoment.model_validate(facts)


def test_cover_is_what_is_known_and_up_is_told_of_the_plans_agents_only() -> None:
    assets = {"Drone_T03": {"status": "failed"}, "Drone_T01": {"at": "Base"}}
    now = seen([], ("Drone_T03", "Drone_T04", "Drone_T99"), assets=assets)
    assert now.covered == {
        "NorthGate": True, "EastGate": True, "SouthGate": False, "WestGate": False,
    }  # fmt: skip
    assert now.up == {"Drone_T03": False, "Drone_T04": True, "Drone_T99": False}


@pytest.mark.parametrize(
    ("command", "robot", "contact"),
    [
        ("identify WestGate", ON_THE_WAY, True),
        ("identify WestGate", AT_GATE, True),
        ("warn WestGate", ON_THE_WAY, True),
        ("move_to WestGate", ON_THE_WAY, True),
        ("move_to WestGate", AT_GATE, False),
        ("hold", AT_GATE, False),
        ("identify EastGate", ON_THE_WAY, False),
        ("move_to Checkpoint", ON_THE_WAY, False),
        ("identify WestGate", {"at": "Checkpoint"}, False),
        ("identify WestGate", ON_THE_WAY | {"status": "failed"}, False),
    ],
)
def test_ground_contact_is_of_an_asset_that_was_sent_to_the_track(
    command: str, robot: dict[str, Any], contact: bool
) -> None:
    assert track_after(command, robot).ground_contact is contact


def test_a_track_inside_meets_whoever_is_sent_anywhere_inside() -> None:
    inside = {"status": "inside", "position": (3.0, 0.0)}
    going = {"at": None, "post": "Checkpoint", "position": (0.0, 0.0)}
    assert track_after("move_to Checkpoint", going, **inside).ground_contact
    assert not track_after("move_to EastGate", going, **inside).ground_contact


@pytest.mark.parametrize(
    ("command", "robot", "facts", "near"),
    [
        ("identify WestGate", ON_THE_WAY | TO_THE_WEST, {}, True),
        ("return_to_base", ON_THE_WAY | TO_THE_WEST, {}, True),
        ("identify WestGate", ON_THE_WAY | TO_THE_WEST | {"heading_deg": 0.0}, {}, False),
        ("identify WestGate", ON_THE_WAY | {"speed_mps": 0.0, "heading_deg": 180.0}, {}, False),
        ("hold", ON_THE_WAY | TO_THE_WEST, {}, False),
        ("identify WestGate", ON_THE_WAY | TO_THE_WEST | {"status": "failed"}, {}, False),
        ("identify WestGate", ON_THE_WAY | TO_THE_WEST, {"uncertainty_m": 2.0}, False),
        ("identify WestGate", ON_THE_WAY | TO_THE_WEST, {"position": (-70.0, 0.0)}, False),
    ],
)
def test_too_near_is_what_the_plans_own_movement_surely_makes_so(
    command: str, robot: dict[str, Any], facts: dict[str, Any], near: bool
) -> None:
    assert track_after(command, robot, **facts).too_near is near


def test_a_uav_is_neither_contact_nor_too_near() -> None:
    now = seen(
        [order("Drone_T04", "observe WestGate")],
        assets={"Drone_T04": ON_THE_WAY | TO_THE_WEST},
        tracks={"V1": {"gate": "WestGate", "position": OUT_5_M}},
    )
    assert not now.tracks["V1"].ground_contact
    assert not now.tracks["V1"].too_near


@pytest.mark.parametrize(
    ("command", "task", "blocked"),
    [
        ("block WestGate", "blocking", True),
        ("block WestGate", "moving", False),
        ("block EastGate", "blocking", False),
        ("move_to WestGate", "blocking", False),
    ],
)
def test_a_track_is_blocked_by_the_plans_own_block_alone(
    command: str, task: str, blocked: bool
) -> None:
    ugv = AT_GATE | {"task": task}
    tracks = {"V1": {"gate": "WestGate"}, "V2": {"gate": "NorthGate"}}
    now = seen([order("Ugv_T02", command)], assets={"Ugv_T02": ugv}, tracks=tracks)
    assert now.tracks["V1"].blocked is blocked
    assert not now.tracks["V2"].blocked


def test_another_threat_is_a_hostile_track_at_the_same_gate_that_has_not_turned_away() -> None:
    tracks = {
        "V1": {"gate": "WestGate", "intent": "hostile"},
        "V2": {"gate": "WestGate"},
        "V3": {"gate": "EastGate", "intent": "hostile", "status": "leaving"},
        "V4": {"gate": "EastGate"},
    }
    threats = {name: t.other_threat for name, t in seen([], tracks=tracks).tracks.items()}
    assert threats == {"V1": False, "V2": True, "V3": False, "V4": False}


@settings(max_examples=100, deadline=None)
@given(st.lists(st.sampled_from(["a", "b", "c"]), max_size=12))
def test_distinct_moments_keep_the_first_of_every_run_that_differs_in_time_only(
    states: list[str],
) -> None:
    drawn = [
        Moment(time_s=float(n), covered={"WestGate": state == "a", "EastGate": state == "b"})
        for n, state in enumerate(states)
    ]
    firsts = [n for n, state in enumerate(states) if n == 0 or states[n - 1] != state]
    assert distinct(drawn) == tuple(drawn[n] for n in firsts)


RULES = Path(__file__).parent / "rule_files" / "noncombatants.yaml"
IN_DEPOT, OUTSIDE = (35.0, 30.0), (90.0, 0.0)
MISSION = Mission(id="M1", text="Go.", created=datetime(2000, 1, 1, tzinfo=UTC))


def pictured(time_s: float, **tracks: dict[str, object]) -> Picture:
    """Return a picture of the example checkpoint at `time_s` in which `tracks` are detected."""
    facts = {name: {"gate": "EastGate", "stamp_s": time_s} | own for name, own in tracks.items()}
    example = RuleExample(name="x", expect="pass", given={"tracks": facts})
    before = example_rehearsal(example, example_plan(example)).before
    return before.model_copy(update={"time_s": time_s})


def test_the_rule_with_a_history_does_as_its_examples_say() -> None:
    for rule in load_rules(RULES).rules:
        for example in rule.examples:
            found = run_example(rule, example).status
            assert {"complies": "pass", "violates": "fail"}.get(found, found) == example.expect


def test_each_track_is_remembered_at_every_place_where_it_was() -> None:
    memory = Sightings(WORLD)
    memory.look(pictured(10.0, V1={"position": IN_DEPOT}))
    memory.look(pictured(20.0, V1={"position": WORLD.frames["EastGate"].at}))
    memory.look(pictured(30.0, V1={"position": OUTSIDE}))
    known = memory.at(pictured(40.0))
    assert [(s["track"], s["place"], s["stamp_s"], s["age_s"]) for s in known] == [
        ("V1", "Depot", 10.0, 30.0), ("V1", "EastGate", 20.0, 20.0), ("V1", "", 30.0, 10.0)
    ]  # fmt: skip


def test_what_turns_out_later_holds_for_where_it_was_before() -> None:
    memory = Sightings(WORLD)
    memory.look(pictured(10.0, V1={"position": IN_DEPOT}))
    assert not any(s["noncombatants"] for s in memory.at(pictured(11.0)))
    memory.look(pictured(20.0, V1={"position": OUTSIDE, "noncombatants": True}))
    assert all(s["noncombatants"] for s in memory.at(pictured(21.0)))


def test_an_hour_later_it_is_forgotten_and_asking_changes_nothing() -> None:
    memory = Sightings(WORLD)
    memory.look(pictured(10.0, V1={"position": IN_DEPOT}))
    assert memory.at(pictured(10.0 + KEPT_S + 1.0)) == []
    assert len(memory.at(pictured(10.0 + KEPT_S))) == 1


@given(st.lists(st.sampled_from([IN_DEPOT, OUTSIDE, (50.0, 0.0), (0.0, 0.0)]), max_size=12))
def test_the_age_at_a_place_is_that_of_the_last_detection_there(
    way: list[tuple[float, float]],
) -> None:
    memory = Sightings(WORLD)
    for second, position in enumerate(way):
        memory.look(pictured(float(second), V1={"position": position}))
    now = float(len(way))
    ages = {s["place"]: s["age_s"] for s in memory.at(pictured(now))}
    places = {IN_DEPOT: "Depot", OUTSIDE: "", (50.0, 0.0): "EastGate", (0.0, 0.0): "Checkpoint"}
    assert ages == {places[position]: now - second for second, position in enumerate(way)}


def test_a_monitor_hands_what_was_seen_to_the_checks() -> None:
    book = load_rules(RULES)
    past = TrackSighting("V1", "Depot", "EastGate", stamp_s=70.0, noncombatants=True)
    example = RuleExample(
        name="x",
        expect="fail",
        plan=(("Ugv_T02", "move_to NorthGate"),),
        given={"timeline": {"assets": {"Ugv_T02": {"entered_zones": ["Depot"]}}}},
    )
    plan = example_plan(example)
    rehearsal = example_rehearsal(example, plan)
    status = {
        name: check_plan(
            book, plan=plan, rehearsal=rehearsal, mission=MISSION, world=WORLD, monitor=monitor
        )[0].status
        for name, monitor in (
            ("seen", Monitor(book, WORLD, Sightings(WORLD, [past])).copy()),
            ("not seen", Monitor(book, WORLD)),
        )
    }
    assert status == {"seen": "violates", "not seen": "complies"}


@pytest.mark.parametrize("wrong", [{"place": "Depot"}, {"track": "V1", "place": "Depot", "x": 1}])
def test_a_sighting_that_makes_no_sense_is_named(wrong: dict[str, object]) -> None:
    rule = load_rules(RULES).rules[0]
    found = run_example(rule, RuleExample(name="x", expect="fail", given={"sightings": [wrong]}))
    assert found.status == "error"
    assert "the example cannot be run" in found.message
