"""Forecasts: built from the picture and the world alone, ideal, and as long as the picture."""

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.schema.incident import (
    FailAsset,
    FalseContact,
    GpsDrift,
    Incident,
    JamArea,
    PlaceAsset,
    SensorFault,
    SetBattery,
    SetComms,
    SetRadio,
    SetWeather,
    SpawnTrack,
    SpoofTelemetry,
)
from pa_console.schema.telemetry import Picture, Track
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint
from tests.sim.running import carry_out, finish, order, run
from tests.sim.test_determinism import commands, incidents, live_through, moments

hidden: st.SearchStrategy[Incident] = st.one_of(
    incidents,
    st.builds(SetRadio, loss=st.floats(0.0, 0.9)),
    st.builds(JamArea, at=st.just((0.0, 0.0)), radius_m=st.floats(1.0, 80.0)),
    st.builds(GpsDrift, asset=st.just("Drone_T01"), rate_mps=st.floats(0.1, 5.0)),
    st.builds(SpoofTelemetry, asset=st.just("Drone_T01"), frame=st.just("Base")),
)


@given(
    past=moments,
    secret=st.lists(hidden, min_size=1, max_size=5),
    future=st.lists(st.tuples(st.integers(1, 40), commands()), max_size=4),
    seeds=st.tuples(st.integers(0, 99), st.integers(100, 199)),
)
@settings(max_examples=25, deadline=None)
def test_equal_pictures_give_equal_forecasts_whatever_the_truth_is(
    world: World,
    past: list[tuple[int, Any]],
    secret: list[Incident],
    future: list[tuple[int, Any]],
    seeds: tuple[int, int],
) -> None:
    sim = Checkpoint(world, seeds[0])
    live_through(sim, past)
    run(sim, 0.5 - sim.tick % 5 * 0.1)
    other = sim.fork()
    for incident in secret:
        other.inject(incident)
    other.step()
    other.step()
    assert sim.picture() == other.picture()
    assert sim.state_hash() != other.state_hash()
    mine, theirs = sim.forecast(), other.forecast()
    assert mine.state_hash() == theirs.state_hash()
    assert mine.picture() == sim.picture()
    live_through(mine, future)
    live_through(theirs, future)
    assert mine.state_hash() == theirs.state_hash()


def test_a_forecast_needs_nothing_but_the_picture_and_the_world(world: World) -> None:
    sim = Checkpoint(world, seed=8)
    sim.inject(SpawnTrack(gate="WestGate"))
    order(sim, "Ugv_T02", "move_to", "SouthGate")
    run(sim, 4.0)
    stranger = Checkpoint(world, seed=99)
    stranger._picture = Picture.model_validate_json(sim.picture().model_dump_json())  # pyright: ignore[reportPrivateUsage]
    assert stranger.forecast().state_hash() == sim.forecast().state_hash()


def test_what_is_only_seen_later_is_not_foreseen(sim: Checkpoint) -> None:
    run(sim, 1.0)
    sim.inject(FailAsset(asset="Drone_T01"))
    forecast = sim.forecast()
    run(forecast, 5.0)
    assert forecast.picture().gates["WestGate"].covered
    run(sim, 0.5)
    assert not sim.forecast().picture().gates["WestGate"].covered


def test_an_asset_under_way_goes_on(sim: Checkpoint) -> None:
    moving = order(sim, "Drone_T04", "observe", "EastGate")
    run(sim, 2.0)
    forecast = sim.forecast()
    replies = finish(forecast, moving)
    run(forecast, 1.0)
    assert replies[-1].status == "done"
    assert forecast.picture().assets["Drone_T04"].at == "EastGate"
    assert "Drone_T04" in forecast.picture().gates["EastGate"].by


def test_a_forecast_ends_like_the_truth_when_nothing_interferes(sim: Checkpoint) -> None:
    run(sim, 1.0)
    forecast = sim.forecast()
    for each in (sim, forecast):
        finish(each, order(each, "Robot_T01", "move_to", "NorthGate", command_id="go"))
        run(each, 1.0)
    true, foreseen = (each.picture().assets["Robot_T01"] for each in (sim, forecast))
    assert foreseen.position == pytest.approx(true.position, abs=0.01)
    assert foreseen.battery_pct == pytest.approx(true.battery_pct, abs=0.2)


def test_silent_and_suspect_assets_cover_and_answer_nothing(sim: Checkpoint) -> None:
    sim.inject(SetComms(asset="Drone_T01", comms="lost"))
    run(sim, 2.0)
    sim.inject(SpoofTelemetry(asset="Drone_T02", frame="EastGate"))
    run(sim, 1.0)
    forecast = sim.forecast()
    before = forecast.picture().assets
    assert before == sim.picture().assets
    order(forecast, "Drone_T01", "move_to", "Base")
    order(forecast, "Drone_T02", "move_to", "Base")
    assert run(forecast, 20.0) == []
    after = forecast.picture()
    for name in ("Drone_T01", "Drone_T02"):
        assert after.assets[name].position == before[name].position
        assert not after.assets[name].available
    assert after.gates["WestGate"].uncovered_s >= 22.0
    assert after.gates["EastGate"].by == ("Ugv_T01",)


def test_nothing_gets_lost_in_a_forecast(sim: Checkpoint) -> None:
    sim.inject(SetRadio(loss=0.5, latency_s=1.0))
    run(sim, 5.0)
    for number in range(30):
        forecast = sim.forecast()
        if not forecast.picture().assets["Drone_T03"].available:
            continue
        order(forecast, "Drone_T03", "report", command_id=str(number))
        assert [reply.status for reply in run(forecast, 0.5)] == ["acknowledged", "done"]


def test_the_battery_of_an_idle_asset_runs_down_in_a_forecast(sim: Checkpoint) -> None:
    sim.inject(SetBattery(asset="Drone_T01", percent=1.0))
    run(sim, 1.0)
    forecast = sim.forecast()
    run(forecast, 40.0)
    assert forecast.picture().assets["Drone_T01"].status == "failed"
    assert not forecast.picture().gates["WestGate"].covered


def test_a_forecast_leaves_the_truth_alone_and_plays_no_scenario(sim: Checkpoint) -> None:
    run(sim, 1.0)
    before = sim.state_hash()
    forecast = sim.forecast()
    order(forecast, "Ugv_T01", "move_to", "Base")
    run(forecast, 10.0)
    assert sim.state_hash() == before
    assert forecast.scenario is None
    assert forecast.take_incidents() == []


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
