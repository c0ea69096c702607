"""Contacts in a forecast: as the picture shows them, whatever the truth behind them is."""

import math

import pytest

from pa_console.schema.incident import FalseContact, PlaceAsset, SensorFault, SetWeather, SpawnTrack
from pa_console.schema.telemetry import Track
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint
from tests.sim.running import carry_out, finish, order, run


def only_track(sim: Checkpoint) -> Track:
    [track] = sim.picture().tracks.values()
    return track


def test_a_forecast_begins_with_the_pictures_tracks(sim: Checkpoint) -> None:
    for gate, away in (("NorthGate", 60.0), ("EastGate", 30.0)):
        sim.inject(SpawnTrack(gate=gate, distance_m=away))
    run(sim, 10.0)
    forecast = sim.forecast()
    assert forecast.picture().tracks == sim.picture().tracks
    for name, expected in forecast.truth().tracks.items():
        known = sim.picture().tracks[name]
        assert expected.position == known.position
        assert (expected.gate, expected.status) == (known.gate, known.status)


def test_an_approaching_track_goes_on_to_wait_at_its_gate(sim: Checkpoint) -> None:
    sim.inject(SpawnTrack(gate="WestGate", distance_m=70.0, speed_mps=4.0))
    run(sim, 5.0)
    forecast = sim.forecast()
    run(forecast, 30.0)
    track = only_track(forecast)
    assert track.status == "stopped"
    assert track.distance_m == pytest.approx(15.0, abs=2.0)
    assert set(track.seen_by) >= {"WestCamera", "Drone_T01"}


def test_a_forecast_does_not_know_the_truth(world: World) -> None:
    hashes: set[str] = set()
    for identity, reaction in (("authorized", "go_on"), ("unauthorized", "leave")):
        sim = Checkpoint(world, seed=4)
        sim.inject(
            SpawnTrack(
                gate="NorthGate",
                distance_m=60.0,
                identity="authorized" if identity == "authorized" else "unauthorized",
                when_warned="go_on" if reaction == "go_on" else "leave",
            )
        )
        run(sim, 8.0)
        forecast = sim.forecast()
        assert finish(forecast, order(forecast, "Robot_T01", "identify", "NorthGate"))[-1].detail
        run(forecast, 1.0)
        assert only_track(forecast).identity == "unauthorized"
        hashes.add(forecast.state_hash())
    assert len(hashes) == 1


def test_a_warned_track_stops_in_a_forecast(sim: Checkpoint) -> None:
    sim.inject(PlaceAsset(asset="Robot_T01", frame="SouthGate"))
    sim.inject(SpawnTrack(gate="SouthGate", distance_m=60.0, when_warned="go_on"))
    run(sim, 3.0)
    forecast = sim.forecast()
    carry_out(forecast, "Robot_T01", "warn", "SouthGate")
    run(forecast, 20.0)
    track = only_track(forecast)
    assert (track.warned, track.status, track.defiant) == (True, "stopped", False)


def test_a_defiant_track_goes_on_in_a_forecast(sim: Checkpoint) -> None:
    sim.inject(SpawnTrack(gate="SouthGate", distance_m=30.0, speed_mps=3.0, when_warned="go_on"))
    carry_out(sim, "Robot_T01", "warn", "SouthGate")
    for _ in range(200):
        if only_track(sim).defiant:
            break
        run(sim, 0.5)
    forecast = sim.forecast()
    assert only_track(forecast).defiant
    run(forecast, 30.0)
    assert only_track(forecast).status == "inside"
    post = sim.world.frames["Checkpoint"].at
    assert math.dist(only_track(forecast).position, post) < 8.0


def test_what_is_confirmed_stays_confirmed(sim: Checkpoint) -> None:
    sim.inject(SpawnTrack(gate="NorthGate", distance_m=30.0, intent="hostile"))
    sim.inject(SpawnTrack(gate="SouthGate", distance_m=30.0, intent="benign"))
    run(sim, 30.0)
    known = {track.gate: track.intent for track in sim.picture().tracks.values()}
    assert known == {"NorthGate": "hostile", "SouthGate": "benign"}
    forecast = sim.forecast()
    run(forecast, 5.0)
    for name, track in forecast.picture().tracks.items():
        assert track.intent == known[track.gate]
        assert set(track.hostile_by) >= set(sim.picture().tracks[name].hostile_by)


def test_a_false_alarm_is_real_to_a_forecast(sim: Checkpoint) -> None:
    sim.inject(FalseContact(gate="EastGate"))
    run(sim, 2.0)
    assert sim.truth().tracks == {}
    assert set(sim.forecast().truth().tracks) == set(sim.picture().tracks) == {"Track_01"}


def test_weather_and_failed_cameras_are_taken_over(sim: Checkpoint) -> None:
    sim.inject(SetWeather(weather="fog"))
    sim.inject(SensorFault(sensor="EastCamera"))
    run(sim, 1.0)
    forecast = sim.forecast()
    run(forecast, 1.0)
    picture = forecast.picture()
    assert picture.weather == "fog"
    assert [name for name, c in picture.cameras.items() if not c.works] == ["EastCamera"]


def test_a_leaving_track_leaves(sim: Checkpoint) -> None:
    sim.inject(SpawnTrack(gate="NorthGate", distance_m=30.0, speed_mps=8.0))
    carry_out(sim, "Robot_T01", "warn", "NorthGate")
    run(sim, 6.0)
    assert only_track(sim).status == "leaving"
    forecast = sim.forecast()
    run(forecast, 60.0)
    assert forecast.picture().tracks == {}
