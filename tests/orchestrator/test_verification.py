"""Telemetry decides whether a plan happened; stale or missing telemetry is unknown, never fine."""

import pytest

from pa_console.orchestrator.verification import verify_plan
from pa_console.resources import find_data
from pa_console.schema.command import CommandReply
from pa_console.schema.plan import Action, Plan
from pa_console.schema.telemetry import Picture
from pa_console.sim.world_file import load_world
from tests.orchestrator.pictures import asset, picture, track

WORLD = load_world(find_data("worlds", "checkpoint", "world.yaml"))
HOME = (
    asset("Drone_T01", "uav", "WestGate"), asset("Drone_T02", "uav", "NorthGate"),
    asset("Drone_T03", "uav", "SouthGate"), asset("Ugv_T01", "ugv", "EastGate"),
)  # fmt: skip


def _verify(command: str, after: Picture, status: str = "done", agent: str = "Drone_T04") -> str:
    plan = Plan(reason="test", actions=(Action(agent=agent, command=command),))
    reply = CommandReply.model_validate(
        {"command_id": "M1.1", "agent": agent, "status": status, "tick": 5}
    )
    return verify_plan(plan, WORLD, picture(*HOME), after, {agent: reply}).outcome


def test_arrival_is_seen_in_telemetry_not_taken_from_the_device() -> None:
    there = picture(*HOME, asset("Drone_T04", "uav", "EastGate"))
    elsewhere = picture(*HOME, asset("Drone_T04", "uav", "Checkpoint"))
    assert _verify("move_to EastGate", there) == "pass"
    assert _verify("move_to EastGate", elsewhere) == "fail"


def test_a_device_that_failed_is_a_failure_even_at_the_right_place() -> None:
    there = picture(*HOME, asset("Drone_T04", "uav", "EastGate"))
    assert _verify("move_to EastGate", there, status="failed") == "fail"


def test_stale_telemetry_is_unknown() -> None:
    stale = picture(*HOME, asset("Drone_T04", "uav", "EastGate", stamp_s=1.0))
    assert _verify("move_to EastGate", stale) == "unknown"


def test_a_gate_that_lost_its_cover_fails_the_mission() -> None:
    gone = picture(*HOME[1:], asset("Drone_T01", "uav", "EastGate"))
    plan = Plan(reason="x", actions=(Action(agent="Drone_T01", command="move_to EastGate"),))
    reply = CommandReply(command_id="M1.1", agent="Drone_T01", status="done", tick=5)
    verification = verify_plan(plan, WORLD, picture(*HOME), gone, {"Drone_T01": reply})
    assert verification.outcome == "fail"
    assert verification.gates_lost == ("WestGate",)


@pytest.mark.parametrize(
    ("identity", "expected"), [("unauthorized", "pass"), ("unknown", "fail"), (None, "unknown")]
)
def test_identify_is_proved_by_the_track(identity: str | None, expected: str) -> None:
    robot = asset("Robot_T01", "robot", "WestGate")
    seen = () if identity is None else (track("V1", "WestGate", identity=identity),)
    after = picture(*HOME, robot, tracks=seen)
    assert _verify("identify WestGate", after, agent="Robot_T01") == expected
