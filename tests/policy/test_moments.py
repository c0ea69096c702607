"""A moment says of tracks what a mission's own orders do to them, and nothing of other assets."""

import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.policy.authoring.examples import WORLD, situation
from pa_console.policy.moments import distinct, moment
from pa_console.schema.plan import Action
from pa_console.schema.rehearsal import Moment, OrderMoment, TrackMoment
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
