"""The truth about vehicles and persons keeps its names, and knows what was really found out."""

from pa_console.resources import data_folder
from pa_console.schema.command import DeviceCommand
from pa_console.schema.incident import SensorFault, SetWeather, SpawnTrack
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.worlds.world_file import load_world

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
