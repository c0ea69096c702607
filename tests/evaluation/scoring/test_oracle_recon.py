"""Ground assets are committed to an unknown vehicle only after a UAV has seen it (WF-01, WF-02)."""

from pa_console.schema.incident import FailAsset, SpawnTrack
from tests.evaluation.scoring.recordings import Take

EAST = SpawnTrack(gate="EastGate", distance_m=60.0)
"""The east gate is watched by a UGV and a camera: no UAV sees what comes there."""


def test_a_robot_sent_ahead_of_any_uav_is_a_breach() -> None:
    take = Take(EAST).do("Robot_T02 identify EastGate")
    assert take.broken == {"WF-01", "WF-02"}


def test_a_uav_that_goes_along_and_is_faster_makes_it_right() -> None:
    take = Take(EAST).do("Drone_T04 observe EastGate", "Robot_T02 identify EastGate")
    assert take.broken == set()


def test_a_uav_that_fails_before_it_has_seen_anything_leaves_the_robot_first() -> None:
    take = Take(EAST).send("Drone_T04 observe EastGate", "Robot_T02 identify EastGate")
    take.sim.inject(FailAsset(asset="Drone_T04"))
    assert "WF-02" in take.send(wait_s=40.0).broken


def test_the_guard_that_stands_there_anyway_commits_nobody() -> None:
    assert Take(EAST).send("Ugv_T01 move_to EastGate", wait_s=20.0).broken == set()
    assert Take(EAST).send("Ugv_T01 hold", wait_s=20.0).broken == set()


def test_one_sent_before_anything_was_there_was_not_committed_to_it() -> None:
    take = Take().send("Ugv_T02 move_to EastGate", wait_s=1.0)
    take.sim.inject(EAST)
    assert take.send(wait_s=25.0).broken == set()


def test_one_called_back_in_time_has_not_been_near() -> None:
    take = Take(EAST).send("Robot_T01 move_to EastGate", wait_s=2.0)
    assert take.send("Robot_T01 move_to Checkpoint", wait_s=15.0).broken == set()
