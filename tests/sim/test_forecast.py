"""Forecasts: built from the picture and the world alone, ideal, and as long as the picture."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.schema.incident import (
    FailAsset,
    GpsDrift,
    Incident,
    JamArea,
    SetBattery,
    SetComms,
    SetRadio,
    SpawnTrack,
    SpoofTelemetry,
)
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint
from tests.sim.running import finish, order, run
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
