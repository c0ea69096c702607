"""Contacts approach, wait short of the gate, are identified and warned, leave, stop or go on."""

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.resources import data_folder, find_data
from pa_console.schema.command import DeviceCommand
from pa_console.schema.document import Document
from pa_console.schema.evaluation import MissionSet
from pa_console.schema.incident import (
    ClearTracks,
    FailAsset,
    FalseContact,
    Incident,
    PlaceAsset,
    RevealTrack,
    SensorFault,
    SetWeather,
    SpawnTrack,
)
from pa_console.schema.telemetry import Track
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.worlds.world_file import load_world
from tests.sim.running import carry_out, finish, order, run


def contact(sim: Checkpoint) -> Track:
    """Return the only contact as it truly is."""
    [track] = sim.truth().tracks.values()
    return track


def only_track(sim: Checkpoint) -> Track:
    """Return the only track of the picture."""
    [track] = sim.picture().tracks.values()
    return track


def test_a_contact_approaches_and_waits_short_of_the_gate(sim: Checkpoint) -> None:
    sim.inject(SpawnTrack(gate="WestGate", speed_mps=5.0))
    first = contact(sim)
    assert first.status == "approaching"
    assert first.distance_m > 100.0
    assert sim.picture().tracks == {}
    run(sim, 10.0)
    assert contact(sim).distance_m == pytest.approx(first.distance_m - 50.0, abs=5.0)
    run(sim, 20.0)
    last, known = contact(sim), only_track(sim)
    assert last.status == known.status == "stopped"
    assert last.speed_mps == known.speed_mps == 0.0
    assert last.distance_m == pytest.approx(1.5 * sim.world.standoff_m, abs=0.5)
    assert math.dist(known.position, last.position) < 4 * known.uncertainty_m
    assert (known.identity, known.gate) == ("unknown", "WestGate")


def test_a_contact_may_start_nearer_but_never_inside_the_standoff(world: World) -> None:
    for wanted, found in ((40.0, 40.0), (1.0, 1.5 * world.standoff_m)):
        sim = Checkpoint(world)
        sim.inject(SpawnTrack(gate="NorthGate", distance_m=wanted))
        assert contact(sim).distance_m == pytest.approx(found, abs=0.5)


def test_contacts_queue_behind_each_other(sim: Checkpoint) -> None:
    for _ in range(3):
        sim.inject(SpawnTrack(gate="EastGate", distance_m=30.0))
    run(sim, 30.0)
    distances = sorted(track.distance_m for track in sim.truth().tracks.values())
    assert distances[0] == pytest.approx(15.0, abs=0.5)
    assert all(b - a > 5.0 for a, b in pairwise(distances))
    assert len(sim.picture().tracks) == 3


def test_the_papers_set_ups_show_their_tracks_within_two_seconds(world: World) -> None:
    path = find_data("worlds", "checkpoint", "missions/paper.yaml")
    missions = Document.read(path).parse(MissionSet).missions
    shown = expected = 0
    for seed in range(10):
        for mission in missions:
            sim = Checkpoint(world, seed)
            for incident in mission.setup:
                sim.inject(incident)
            run(sim, 2.0)
            gates = [i.gate for i in mission.setup if isinstance(i, SpawnTrack)]
            tracks = sim.picture().tracks.values()
            assert {track.gate for track in tracks} <= set(gates)
            expected += len(gates)
            shown += len(tracks)
    assert shown >= 0.98 * expected > 0


def test_only_a_uav_in_range_observes(sim: Checkpoint) -> None:
    sim.inject(SpawnTrack(gate="EastGate"))
    run(sim, 30.0)
    assert not only_track(sim).observed
    assert set(only_track(sim).seen_by) == {"EastCamera", "Ugv_T01"}
    carry_out(sim, "Drone_T04", "observe", "EastGate")
    run(sim, 1.0)
    assert only_track(sim).observed_by == ("Drone_T04",)
    carry_out(sim, "Drone_T04", "return_to_base")
    assert only_track(sim).observed


def test_identify_finds_the_truth(sim: Checkpoint) -> None:
    sim.inject(SpawnTrack(gate="NorthGate", identity="authorized", intent="benign"))
    reply = carry_out(sim, "Robot_T01", "identify", "NorthGate")[-1]
    assert reply.status == "done"
    run(sim, 1.0)
    assert (only_track(sim).identity, only_track(sim).intent) == ("authorized", "benign")
    assert sim.picture().assets["Robot_T01"].at == "NorthGate"


def test_identify_waits_for_a_contact_on_its_way(sim: Checkpoint) -> None:
    sim.inject(PlaceAsset(asset="Robot_T01", frame="NorthGate"))
    sim.inject(SpawnTrack(gate="NorthGate", speed_mps=2.0))
    command = order(sim, "Robot_T01", "identify", "NorthGate")
    run(sim, 20.0)
    assert only_track(sim).identity == "unknown"
    assert sim.picture().assets["Robot_T01"].task == "identifying"
    assert finish(sim, command)[-1].status == "done"


def test_a_hostile_contact_is_known_for_hostile_by_two_sensors(sim: Checkpoint) -> None:
    sim.inject(SpawnTrack(gate="SouthGate", distance_m=30.0, intent="hostile"))
    run(sim, 30.0)
    track = only_track(sim)
    assert (track.intent, track.identity) == ("hostile", "unknown")
    assert set(track.hostile_by) == {"Drone_T03", "SouthCamera"}


def test_one_that_obeys_the_warning_leaves(sim: Checkpoint) -> None:
    sim.inject(SpawnTrack(gate="SouthGate", speed_mps=8.0))
    assert carry_out(sim, "Robot_T01", "warn", "SouthGate")[-1].status == "done"
    run(sim, 1.0)
    assert only_track(sim).warned
    run(sim, 5.0)
    assert contact(sim).status == only_track(sim).status == "leaving"
    run(sim, 50.0)
    assert sim.truth().tracks == sim.picture().tracks == {}


def test_one_may_stop_where_it_is_warned(sim: Checkpoint) -> None:
    sim.inject(SpawnTrack(gate="SouthGate", speed_mps=8.0, when_warned="stop"))
    carry_out(sim, "Robot_T01", "warn", "SouthGate")
    stood = contact(sim).position
    run(sim, 60.0)
    assert (contact(sim).status, contact(sim).position) == ("stopped", stood)
    assert (only_track(sim).warned, only_track(sim).defiant) == (True, False)


def test_one_that_goes_on_drives_past_a_robot_into_the_perimeter(sim: Checkpoint) -> None:
    sim.inject(SpawnTrack(gate="SouthGate", speed_mps=8.0, when_warned="go_on"))
    carry_out(sim, "Robot_T01", "warn", "SouthGate")
    run(sim, 30.0)
    truth, known = contact(sim), only_track(sim)
    assert truth.status == known.status == "inside"
    assert math.dist(truth.position, sim.world.frames["Checkpoint"].at) < 8.0
    assert (known.warned, known.defiant) == (True, True)


def test_a_blocked_gate_holds_it_until_the_way_is_free(sim: Checkpoint) -> None:
    sim.inject(SpawnTrack(gate="NorthGate", speed_mps=8.0, when_warned="go_on"))
    assert carry_out(sim, "Ugv_T02", "block", "NorthGate")[-1].status == "done"
    carry_out(sim, "Robot_T01", "warn", "NorthGate")
    run(sim, 30.0)
    assert contact(sim).status == only_track(sim).status == "stopped"
    assert contact(sim).distance_m == pytest.approx(15.0, abs=1.0)
    assert not only_track(sim).defiant
    sim.inject(FailAsset(asset="Ugv_T02"))
    run(sim, 20.0)
    assert contact(sim).status == "inside"
    assert only_track(sim).defiant


def test_the_truth_behind_a_named_contact_can_change(sim: Checkpoint) -> None:
    sim.inject(SpawnTrack(gate="NorthGate", when_warned="stop", name="van", distance_m=30.0))
    carry_out(sim, "Robot_T01", "warn", "NorthGate")
    sim.inject(RevealTrack(track="van", identity="authorized", when_warned="leave"))
    assert contact(sim).identity == "authorized"
    run(sim, 2.5)
    assert contact(sim).status == "leaving"
    with pytest.raises(ValueError, match=r"no contact named 'bus'; known: van"):
        sim.inject(RevealTrack(track="bus", intent="hostile"))
    run(sim, 60.0)
    sim.inject(RevealTrack(track="van", intent="hostile"))
    assert sim.truth().tracks == {}


def test_one_that_turns_back_inside_leaves_by_its_gate(sim: Checkpoint) -> None:
    sim.inject(SpawnTrack(gate="EastGate", speed_mps=8.0, when_warned="go_on", name="van"))
    carry_out(sim, "Robot_T01", "warn", "EastGate")
    run(sim, 20.0)
    assert contact(sim).status == "inside"
    sim.inject(RevealTrack(track="van", when_warned="leave"))
    run(sim, 8.0)
    assert contact(sim).status == "leaving"
    run(sim, 60.0)
    assert sim.truth().tracks == {}


@pytest.mark.parametrize("gate", ["NorthGate", "EastGate", "SouthGate", "WestGate"])
def test_ground_assets_at_a_gate_keep_the_standoff(world: World, gate: str) -> None:
    sim = Checkpoint(world)
    sim.inject(SpawnTrack(gate=gate, speed_mps=12.0))
    agents = ["Ugv_T01", "Ugv_T02", "Robot_T01", "Robot_T02"]
    for agent in agents:
        order(sim, agent, "move_to", gate)
    for _ in range(600):
        sim.step()
        if sim.tick % 2:
            continue
        truth = sim.truth()
        for track in truth.tracks.values():
            for agent in agents:
                gap = math.dist(truth.assets[agent].position, track.position)
                assert gap >= world.standoff_m
    assert set(agents) <= set(sim.picture().gates[gate].by)


def test_clearing_a_gate_leaves_the_others(sim: Checkpoint) -> None:
    for gate in ("SouthGate", "NorthGate"):
        sim.inject(SpawnTrack(gate=gate, distance_m=30.0))
    run(sim, 2.0)
    assert len(sim.picture().tracks) == 2
    sim.inject(ClearTracks(gate="SouthGate"))
    for _ in range(20):
        run(sim, 0.5)
        assert only_track(sim).gate == contact(sim).gate == "NorthGate"
    sim.inject(SpawnTrack(gate="SouthGate", distance_m=30.0))
    run(sim, 2.0)
    assert {track.gate for track in sim.picture().tracks.values()} == {"NorthGate", "SouthGate"}


def test_a_camera_that_fails_is_shown(sim: Checkpoint) -> None:
    assert {c.gate for c in sim.picture().cameras.values() if c.works} == set(sim.world.gates)
    sim.inject(SensorFault(sensor="WestCamera"))
    run(sim, 1.0)
    report = sim.picture().cameras["WestCamera"]
    assert (report.works, report.stamp_s) == (False, sim.picture().time_s)


happenings: st.SearchStrategy[Incident] = st.one_of(
    st.builds(
        SpawnTrack,
        gate=st.sampled_from(["NorthGate", "EastGate"]),
        intent=st.sampled_from(["benign", "hostile"]),
        distance_m=st.sampled_from([15.0, 40.0, None]),
        when_warned=st.sampled_from(("leave", "stop", "go_on")),
    ),
    st.builds(SensorFault, sensor=st.sampled_from(["NorthCamera", "Drone_T02", "Ugv_T01"])),
    st.builds(SetWeather, weather=st.sampled_from(["clear", "rain", "fog"])),
    st.builds(FalseContact, gate=st.just("NorthGate"), seconds=st.just(8.0)),
    st.builds(ClearTracks, gate=st.sampled_from(["NorthGate", "EastGate"])),
)


@given(
    history=st.lists(st.tuples(st.integers(1, 150), happenings), min_size=1, max_size=5),
    seed=st.integers(0, 2**32),
)
@settings(max_examples=25, deadline=None)
def test_tracks_never_say_more_than_sensors_do(
    world: World, history: list[tuple[int, Incident]], seed: int
) -> None:
    sim = Checkpoint(world, seed)
    order(sim, "Robot_T01", "warn", "NorthGate")
    known: set[str] = set()
    for steps, happening in history:
        sim.inject(happening)
        twin = sim.fork()
        for _ in range(steps):
            sim.step()
            for track in sim.picture().tracks.values():
                if track.id not in known:
                    assert track.seen_by
                    assert track.first_seen_s <= track.stamp_s <= sim.picture().time_s
                    known.add(track.id)
                assert (track.intent == "hostile") == (len(track.hostile_by) >= 2)
                assert set(track.observed_by) <= set(track.seen_by)
                assert track.identity == "unknown"
        for _ in range(steps):
            twin.step()
        assert twin.state_hash() == sim.state_hash()


WORLD = load_world(data_folder() / "worlds" / "checkpoint" / "world.yaml")


def after(sim: Checkpoint, seconds: float) -> Checkpoint:
    for _ in range(round(seconds / sim.world.dt_s)):
        sim.step()
    return sim


def test_a_contact_keeps_its_name_when_the_station_begins_to_track_it_and_when_it_loses_it() -> (
    None
):
    sim = Checkpoint(WORLD)
    sim.inject(SpawnTrack(gate="WestGate", distance_m=60.0))
    [before] = sim.true_contacts()
    [tracked] = after(sim, 2.0).true_contacts()
    for sensor in (*WORLD.cameras, *WORLD.assets):
        sim.inject(SensorFault(sensor=sensor))
    [unseen] = after(sim, 5.0).true_contacts()
    [lost] = after(sim, 20.0).true_contacts()
    assert before.id == tracked.id == unseen.id == lost.id
    assert (before.track, bool(tracked.track), lost.track) == ("", True, "")
    assert unseen.unseen_s is not None
    assert unseen.unseen_s >= 4.5
    assert (tracked.watched_by, unseen.watched_by) == (("Drone_T01",), ())


def test_it_is_identified_once_a_robot_has_done_so() -> None:
    sim = Checkpoint(WORLD)
    sim.inject(SpawnTrack(gate="WestGate", distance_m=60.0))
    command = DeviceCommand(command_id="1", agent="Robot_T01", verb="identify", target="WestGate")
    sim.send(command)
    [early] = after(sim, 5.0).true_contacts()
    [late] = after(sim, 40.0).true_contacts()
    assert (early.identified, late.identified) == (False, True)


def test_fog_takes_it_out_of_a_uavs_range() -> None:
    sim = Checkpoint(WORLD)
    sim.inject(SpawnTrack(gate="WestGate", distance_m=50.0, speed_mps=0.5))
    [clear] = sim.true_contacts()
    sim.inject(SetWeather(weather="fog"))
    [fog] = sim.true_contacts()
    assert (clear.watched_by, fog.watched_by) == (("Drone_T01",), ())
