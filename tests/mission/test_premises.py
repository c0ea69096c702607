"""What a running plan relies on: which news halts it, which does not, and where its agents go."""

from typing import Any

import pytest

from pa_console.mission.execution.premises import Premises, safe_state, way_to_safety, why_lost
from pa_console.resources import data_folder
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import GateTimeline, Timeline
from pa_console.schema.telemetry import AssetTelemetry, GateCover, Picture, Track
from pa_console.sim.worlds.world_file import load_world
from tests.mission.pictures import GATES, asset, picture, track

WORLD = load_world(data_folder() / "worlds" / "checkpoint" / "world.yaml")
FAILED = {"status": "failed", "available": False}
SILENT = {"comms": "lost", "available": False, "stale": True, "stamp_s": 1.0}
EMPTY = {"battery_pct": 0.0, "available": False}
SUSPECT = {"integrity": "suspect", "available": False}
LATE = {"comms": "degraded", "stale": True, "available": False}


def team(**changes: dict[str, Any]) -> list[AssetTelemetry]:
    """Return the checkpoint's team at its posts, but for `changes` by name."""
    return [
        asset(name, spec.kind, spec.post).model_copy(update=changes.get(name, {}))
        for name, spec in WORLD.assets.items()
    ]


def plan(*orders: tuple[str, str]) -> Plan:
    return Plan(reason="r", actions=tuple(Action(agent=a, command=c) for a, c in orders))


def rehearsed(gap_s: float = 0.0) -> Timeline:
    """Return a rehearsal that left every gate bare for at most `gap_s`."""
    gate = GateTimeline(covered_before=True, covered_after=True, longest_gap_s=gap_s)
    return Timeline(duration_s=20.0, gates=dict.fromkeys(GATES, gate))


def premises(made: Plan, *tracks: Track, timeline: Timeline | None = None) -> Premises:
    return Premises(WORLD, made, picture(*team(), tracks=tracks), timeline or rehearsed())


def bare(now: Picture, gate: str, **cover: Any) -> Picture:
    """Return `now` with `gate` without known cover."""
    gates = now.gates | {gate: GateCover(covered=False, **cover)}
    return now.model_copy(update={"gates": gates})


RECON = plan(("Drone_T04", "observe WestGate"))


def test_nothing_changed_and_nothing_is_broken() -> None:
    seen = track("Track_01", "WestGate")
    assert premises(RECON, seen).broken(picture(*team(), tracks=(seen,)), ["Drone_T04"]) == ()


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (FAILED, "failed"),
        (EMPTY, "empty battery"),
        (SUSPECT, "suspect telemetry"),
        (SILENT, "silent for 9 s"),
        (LATE, ""),
        ({"comms": "degraded"}, ""),
        ({"status": "degraded"}, ""),
        ({"low_battery": True, "battery_pct": 19.0}, ""),
    ],
)
def test_an_agent_under_way_is_lost_by_what_it_cannot_come_back_from(
    change: dict[str, Any], why: str
) -> None:
    now = picture(*team(Drone_T04=change))
    broken = premises(RECON).broken(now, ["Drone_T04"])
    assert bool(broken) == bool(why)
    assert why in " ".join(broken)
    assert all("Drone_T04" in text for text in broken)
    assert why in why_lost(now.assets["Drone_T04"], now)
    assert premises(RECON).broken(now, []) == (), "its part of the plan is over"
    other = plan(("Drone_T01", "report"))
    assert premises(other).broken(now, ["Drone_T01"]) == (), "it has no part in the plan"


def test_an_agent_that_was_lost_when_the_plan_was_approved_breaks_nothing() -> None:
    before = picture(*team(Drone_T04=SUSPECT))
    made = Premises(WORLD, RECON, before, rehearsed())
    assert made.broken(picture(*team(Drone_T04=FAILED)), ["Drone_T04"]) == ()


def test_an_agent_that_the_picture_lacks_breaks_nothing() -> None:
    now = picture(*[a for a in team() if a.id != "Drone_T04"])
    assert premises(RECON).broken(now, ["Drone_T04"]) == ()


@pytest.mark.parametrize("change", [FAILED, SILENT, SUSPECT, EMPTY])
def test_a_guard_that_is_lost_breaks_the_plan_of_its_gate(change: dict[str, Any]) -> None:
    now = picture(*team(Drone_T01=change))
    [broken] = premises(RECON).broken(now, ["Drone_T04"])
    assert broken == "WestGate: it is not covered: Drone_T01 cannot be counted on"
    elsewhere = plan(("Drone_T04", "observe EastGate"))
    assert premises(elsewhere).broken(now, ["Drone_T04"]) == (), "another gate's alarm sees to it"


def test_a_guard_whose_reports_are_late_breaks_nothing_until_it_lasts() -> None:
    now = picture(*team(Drone_T01=LATE))
    allowed = 4.0 + WORLD.link_lost_s
    made = premises(RECON, timeline=rehearsed(4.0))
    short = bare(now, "WestGate", uncovered_s=allowed, unsure=("Drone_T01",))
    long = bare(now, "WestGate", uncovered_s=allowed + 0.5, unsure=("Drone_T01",))
    assert made.broken(short, ["Drone_T04"]) == ()
    assert made.broken(long, ["Drone_T04"]) == ("WestGate: its cover is unknown",)


def test_a_gap_that_was_rehearsed_is_none() -> None:
    leaving = plan(("Drone_T01", "move_to EastGate"), ("Drone_T04", "move_to WestGate"))
    now = bare(
        picture(*team(Drone_T01={"at": None, "post": "EastGate"})), "WestGate", uncovered_s=9.0
    )
    agents = ["Drone_T01", "Drone_T04"]
    assert premises(leaving, timeline=rehearsed(9.0)).broken(now, agents) == ()
    assert premises(leaving, timeline=rehearsed(0.0)).broken(now, agents)


def test_a_gate_that_nobody_covered_cannot_lose_its_cover() -> None:
    before = picture(*team(Drone_T01=FAILED))
    made = Premises(WORLD, RECON, before, rehearsed())
    now = bare(before, "WestGate", uncovered_s=60.0)
    assert made.broken(now, ["Drone_T04"]) == ()


CALM, HOSTILE = {"intent": "unknown"}, {"intent": "hostile", "identity": "unauthorized"}
BENIGN, KNOWN = {"intent": "benign"}, {"identity": "authorized"}
OBSERVE, IDENTIFY = ("Drone_T04", "observe WestGate"), ("Robot_T01", "identify WestGate")
WARN, BLOCK = ("Robot_T02", "warn WestGate"), ("Ugv_T02", "block WestGate")


@pytest.mark.parametrize(
    ("orders", "turn", "halts"),
    [
        ([OBSERVE], HOSTILE, True),
        ([IDENTIFY], HOSTILE, True),
        ([WARN], HOSTILE, True),
        ([BLOCK], HOSTILE, False),
        ([BLOCK, OBSERVE], HOSTILE, False),
        ([OBSERVE, BLOCK], HOSTILE, False),
        ([OBSERVE], BENIGN, False),
        ([BLOCK], BENIGN, True),
        ([OBSERVE, BLOCK], BENIGN, True),
        ([BLOCK, OBSERVE], BENIGN, True),
        ([WARN], BENIGN, False),
        ([WARN], KNOWN, True),
        ([IDENTIFY, WARN], KNOWN, True),
        ([WARN, IDENTIFY], KNOWN, True),
        ([IDENTIFY], KNOWN, False),
        ([("Drone_T04", "move_to WestGate")], HOSTILE, False),
    ],
)
def test_a_track_that_turns_out_otherwise_halts_the_plan_that_deals_with_it(
    orders: list[tuple[str, str]], turn: dict[str, str], halts: bool
) -> None:
    made = premises(plan(*orders), track("Track_01", "WestGate", **CALM))
    agents = [agent for agent, _ in orders]
    turned = picture(*team(), tracks=(track("Track_01", "WestGate", **turn),))
    broken = made.broken(turned, agents)
    assert bool(broken) == halts
    assert all("Track_01 at WestGate" in text for text in broken)
    assert made.broken(turned, []) == (), "nobody deals with it any more"
    away = picture(*team(), tracks=(track("Track_01", "EastGate", **turn),))
    assert made.broken(away, agents) == (), "another gate's track is not the plan's"


def test_a_track_that_was_hostile_when_the_plan_was_approved_is_no_news() -> None:
    hostile = track("Track_01", "WestGate", **HOSTILE)
    now = picture(*team(), tracks=(hostile,))
    assert premises(plan(WARN), hostile).broken(now, ["Robot_T02"]) == ()
    assert premises(plan(WARN)).broken(now, ["Robot_T02"]), "one that appears only now is"


def commands(made: Premises, now: Picture, *agents: str) -> list[str]:
    declared = way_to_safety(made.plan, WORLD, made.before)
    found = safe_state(declared, now, agents, "M1.halt1")
    assert [command.command_id for command in found] == [
        f"M1.halt1.{number}" for number in range(1, len(found) + 1)
    ]
    return [f"{c.agent} {c.verb} {c.target or ''}".strip() for c in found]


def test_whoever_left_a_gate_that_nobody_else_covers_goes_back_and_the_rest_hold() -> None:
    made = premises(plan(("Drone_T01", "move_to EastGate"), ("Drone_T04", "move_to WestGate")))
    moved = team(Drone_T01={"at": None, "post": "EastGate"})
    assert commands(made, picture(*moved), "Drone_T01", "Drone_T04") == [
        "Drone_T01 move_to WestGate",
        "Drone_T04 hold",
    ]


@pytest.mark.parametrize(
    ("facts", "other", "halts"),
    [
        ({}, None, True),
        ({"kind": "person"}, None, True),
        ({"identity": "unauthorized"}, None, False),
        ({"status": "leaving"}, None, False),
        ({}, {"identity": "unauthorized"}, False),
        ({}, {"identity": "unauthorized", "warned": True}, True),
    ],
)
def test_a_warning_under_way_is_not_given_to_whoever_comes_unidentified(
    facts: dict[str, Any], other: dict[str, Any] | None, halts: bool
) -> None:
    """While somebody identified has yet to be warned, the robot warns that one."""
    there = () if other is None else (track("Track_01", "WestGate", **other),)
    came = track("Track_02", "WestGate", **facts)
    made = premises(plan(("Robot_T01", "warn WestGate")), *there)
    broken = made.broken(picture(*team(), tracks=(*there, came)), ["Robot_T01"])
    assert any("Track_02 has come to WestGate" in why for why in broken) == halts


def test_whoever_left_a_gate_that_another_covers_now_holds() -> None:
    made = premises(plan(("Drone_T01", "move_to EastGate"), ("Drone_T04", "move_to WestGate")))
    relieved = team(
        Drone_T01={"at": None, "post": "EastGate"},
        Drone_T04={"at": "WestGate", "post": "WestGate"},
    )
    assert commands(made, picture(*relieved), "Drone_T01") == ["Drone_T01 hold"]


def test_whoever_still_stands_at_its_gate_holds_and_whoever_is_lost_is_told_nothing() -> None:
    made = premises(plan(("Drone_T01", "observe WestGate"), ("Drone_T02", "move_to EastGate")))
    now = picture(*team(Drone_T01={"post": "WestGate"}, Drone_T02=SILENT))
    assert commands(made, bare(now, "WestGate"), "Drone_T01", "Drone_T02") == ["Drone_T01 hold"]
    assert commands(made, now) == []


def test_whoever_is_on_its_way_goes_back_although_the_late_picture_shows_it_at_its_gate() -> None:
    made = premises(plan(("Drone_T01", "observe EastGate"), ("Drone_T04", "observe WestGate")))
    now = picture(*team())
    assert commands(made, now, "Drone_T01", "Drone_T04") == [
        "Drone_T01 move_to WestGate",
        "Drone_T04 hold",
    ]


def test_a_relief_that_is_itself_under_way_elsewhere_does_not_count_as_cover() -> None:
    made = premises(plan(("Drone_T01", "move_to EastGate"), ("Drone_T04", "move_to SouthGate")))
    passing = team(
        Drone_T01={"at": None, "post": "EastGate"},
        Drone_T04={"at": "WestGate", "post": "WestGate"},
    )
    assert commands(made, picture(*passing), "Drone_T01", "Drone_T04") == [
        "Drone_T01 move_to WestGate",
        "Drone_T04 hold",
    ]


def test_the_way_to_safety_leads_back_to_the_gate_that_the_plan_leaves_and_nowhere_else() -> None:
    made = plan(
        ("Drone_T01", "move_to EastGate"),
        ("Drone_T02", "report"),
        ("Ugv_T01", "observe EastGate"),
        ("Robot_T01", "hold"),
        ("Drone_T04", "move_to WestGate"),
    )
    declared = way_to_safety(made, WORLD, picture(*team()))
    assert [f"{action.agent} {action.command}" for action in declared] == [
        "Drone_T01 move_to WestGate",
        "Drone_T02 hold",
        "Ugv_T01 hold",
        "Robot_T01 hold",
        "Drone_T04 hold",
    ]


@pytest.mark.parametrize(
    ("facts", "threat", "halts"),
    [
        ({}, False, True),
        ({"identity": "authorized"}, False, True),
        ({"kind": "person"}, False, True),
        ({"status": "leaving"}, False, False),
        ({}, True, False),
    ],
)
def test_a_block_gives_way_to_whoever_comes_while_it_is_under_way(
    facts: dict[str, Any], threat: bool, halts: bool
) -> None:
    """What the attacker found: a gate is blocked while nobody is there, then somebody comes."""
    hostile = {"identity": "unauthorized", "intent": "hostile", "warned": True}
    there = (track("Track_01", "WestGate", **hostile),) if threat else ()
    came = track("Track_02", "WestGate", **facts)
    made = premises(plan(("Ugv_T02", "block WestGate")), *there)
    broken = made.broken(picture(*team(), tracks=(*there, came)), ["Ugv_T02"])
    assert any("Track_02 has come to WestGate" in why for why in broken) == halts
    elsewhere = track("Track_02", "EastGate", **facts)
    assert not made.broken(picture(*team(), tracks=(*there, elsewhere)), ["Ugv_T02"])
