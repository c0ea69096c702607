"""Tracks approach, wait short of the gate, are seen, identified, warned, and leave."""

import math
from itertools import pairwise

import pytest

from pa_console.schema.incident import ClearTracks, PlaceAsset, SpawnTrack
from pa_console.schema.telemetry import Track
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint
from tests.sim.running import carry_out, finish, order, run


def only_track(sim: Checkpoint) -> Track:
    [track] = sim.picture().tracks.values()
    return track


def test_a_track_approaches_and_waits_short_of_the_gate(sim: Checkpoint) -> None:
    sim.inject(SpawnTrack(gate="WestGate", speed_mps=5.0))
    first = only_track(sim)
    assert first.status == "approaching"
    assert first.distance_m > 100.0
    assert (first.identity, first.intent) == ("unknown", "unknown")
    run(sim, 10.0)
    assert only_track(sim).distance_m == pytest.approx(first.distance_m - 50.0, abs=5.0)
    run(sim, 20.0)
    last = only_track(sim)
    assert last.status == "stopped"
    assert last.speed_mps == 0.0
    assert last.distance_m == pytest.approx(1.5 * sim.world.standoff_m, abs=0.5)


def test_a_track_may_start_nearer(sim: Checkpoint) -> None:
    sim.inject(SpawnTrack(gate="NorthGate", distance_m=40.0))
    assert only_track(sim).distance_m == pytest.approx(40.0, abs=0.5)


def test_a_track_never_starts_inside_the_standoff(sim: Checkpoint) -> None:
    sim.inject(SpawnTrack(gate="NorthGate", distance_m=1.0))
    assert only_track(sim).distance_m > sim.world.standoff_m


def test_tracks_queue_behind_each_other(sim: Checkpoint) -> None:
    for _ in range(3):
        sim.inject(SpawnTrack(gate="EastGate", distance_m=30.0))
    run(sim, 30.0)
    distances = sorted(track.distance_m for track in sim.picture().tracks.values())
    assert distances[0] == pytest.approx(15.0, abs=0.5)
    assert all(b - a > 5.0 for a, b in pairwise(distances))


def test_only_a_uav_in_range_observes(sim: Checkpoint) -> None:
    sim.inject(SpawnTrack(gate="EastGate"))
    run(sim, 30.0)
    assert not only_track(sim).observed
    carry_out(sim, "Drone_T04", "observe", "EastGate")
    assert only_track(sim).observed_by == ("Drone_T04",)
    carry_out(sim, "Drone_T04", "return_to_base")
    assert only_track(sim).observed


def test_identify_finds_the_truth(sim: Checkpoint) -> None:
    sim.inject(SpawnTrack(gate="NorthGate", identity="authorized", intent="benign"))
    reply = carry_out(sim, "Robot_T01", "identify", "NorthGate")[-1]
    assert reply.status == "done"
    assert (only_track(sim).identity, only_track(sim).intent) == ("authorized", "benign")
    assert sim.picture().assets["Robot_T01"].at == "NorthGate"


def test_identify_waits_for_a_track_on_its_way(sim: Checkpoint) -> None:
    sim.inject(PlaceAsset(asset="Robot_T01", frame="NorthGate"))
    sim.inject(SpawnTrack(gate="NorthGate", speed_mps=2.0))
    command = order(sim, "Robot_T01", "identify", "NorthGate")
    run(sim, 10.0)
    assert only_track(sim).identity == "unknown"
    assert sim.picture().assets["Robot_T01"].task == "identifying"
    assert finish(sim, command)[-1].status == "done"


def test_a_track_that_obeys_the_warning_leaves(sim: Checkpoint) -> None:
    sim.inject(SpawnTrack(gate="SouthGate", speed_mps=8.0))
    assert carry_out(sim, "Robot_T01", "warn", "SouthGate")[-1].status == "done"
    assert only_track(sim).warned
    run(sim, 5.0)
    assert only_track(sim).status == "leaving"
    run(sim, 30.0)
    assert sim.picture().tracks == {}


def test_a_track_that_does_not_obey_stays(sim: Checkpoint) -> None:
    sim.inject(SpawnTrack(gate="SouthGate", speed_mps=8.0, when_warned="go_on"))
    carry_out(sim, "Robot_T01", "warn", "SouthGate")
    run(sim, 60.0)
    assert (only_track(sim).warned, only_track(sim).status) == (True, "stopped")


@pytest.mark.parametrize("gate", ["NorthGate", "EastGate", "SouthGate", "WestGate"])
def test_ground_assets_at_a_gate_keep_the_standoff(world: World, gate: str) -> None:
    sim = Checkpoint(world.model_copy(update={"telemetry_period_s": 0.1}))
    sim.inject(SpawnTrack(gate=gate, speed_mps=12.0))
    agents = ["Ugv_T01", "Ugv_T02", "Robot_T01", "Robot_T02"]
    for agent in agents:
        order(sim, agent, "move_to", gate)
    for _ in range(600):
        sim.step()
        picture = sim.picture()
        for track in picture.tracks.values():
            for agent in agents:
                gap = math.dist(picture.assets[agent].position, track.position)
                assert gap >= world.standoff_m
    assert set(agents) <= set(sim.picture().gates[gate].by)


def test_clearing_a_gate_leaves_the_others(sim: Checkpoint) -> None:
    sim.inject(SpawnTrack(gate="SouthGate"))
    sim.inject(SpawnTrack(gate="NorthGate"))
    sim.inject(ClearTracks(gate="SouthGate"))
    assert only_track(sim).gate == "NorthGate"
    sim.inject(SpawnTrack(gate="SouthGate"))
    assert len(sim.picture().tracks) == 2
