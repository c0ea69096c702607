"""Forged and drifting positions: what is found suspect, and when it is believed again."""

from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pa_console.schema.incident import (
    GpsDrift,
    PlaceAsset,
    SensorFault,
    SetComms,
    SetRadio,
    SpoofTelemetry,
)
from pa_console.schema.telemetry import AssetTelemetry
from pa_console.schema.world import Camera, World
from pa_console.sim.checkpoint import Checkpoint
from tests.sim.running import order, run
from tests.sim.test_determinism import commands, honest, live_through


def of(sim: Checkpoint, name: str) -> AssetTelemetry:
    return sim.picture().assets[name]


@pytest.fixture
def bare(world: World) -> Checkpoint:
    """The default checkpoint without cameras, so that only physics can tell."""
    return Checkpoint(world.model_copy(update={"cameras": {}}), seed=1)


@pytest.fixture
def watched(world: World) -> Checkpoint:
    """The default checkpoint with one camera, at the east gate."""
    camera = Camera(gate="EastGate", at=(40.0, 0.0), heading_deg=0.0, sensor_range_m=60.0)
    return Checkpoint(world.model_copy(update={"cameras": {"Cam_East": camera}}), seed=1)


@pytest.mark.parametrize("asset", ["Drone_T01", "Ugv_T02", "Robot_T01"])
def test_a_jump_is_suspect_until_it_is_over_and_then_for_some_seconds(
    bare: Checkpoint, asset: str
) -> None:
    run(bare, 2.0)
    bare.inject(SpoofTelemetry(asset=asset, frame="EastGate"))
    run(bare, 1.0)
    assert (of(bare, asset).at, of(bare, asset).integrity) == ("EastGate", "suspect")
    assert not of(bare, asset).available
    cover = bare.picture().gates["EastGate"]
    assert (cover.by, cover.unsure) == (("Ugv_T01",), (asset,))
    run(bare, 90.0)
    assert of(bare, asset).integrity == "suspect", "waiting does not make it true"
    bare.inject(SpoofTelemetry(asset=asset, frame=None))
    run(bare, 2.0)
    assert of(bare, asset).integrity == "suspect"
    run(bare, 3.0)
    assert (of(bare, asset).integrity, of(bare, asset).available) == ("ok", True)
    assert of(bare, asset).at == bare.world.assets[asset].post


@pytest.mark.parametrize("rate_mps", [0.2, 1.0, 5.0])
def test_the_drift_of_an_asset_that_stands_is_found_and_forgiven(
    bare: Checkpoint, rate_mps: float
) -> None:
    run(bare, 2.0)
    bare.inject(GpsDrift(asset="Drone_T01", rate_mps=rate_mps, heading_deg=90.0))
    run(bare, 3.0 / rate_mps + 1.5)
    assert of(bare, "Drone_T01").integrity == "suspect"
    assert bare.truth().assets["Drone_T01"].at == "WestGate"
    assert bare.truth().gates["WestGate"].covered
    assert not bare.picture().gates["WestGate"].covered
    run(bare, 20.0)
    assert of(bare, "Drone_T01").integrity == "suspect"
    bare.inject(GpsDrift(asset="Drone_T01", rate_mps=0.0))
    run(bare, 5.0)
    assert (of(bare, "Drone_T01").integrity, of(bare, "Drone_T01").at) == ("ok", "WestGate")
    assert bare.picture().gates["WestGate"].covered


def test_honest_assets_are_never_suspect(world: World) -> None:
    sim = Checkpoint(world, seed=7)
    sim.inject(SetRadio(loss=0.4, latency_s=0.2, jitter_s=1.0))
    posts = ["EastGate", "WestGate", "Base", "NorthGate", "SouthGate", "Checkpoint"]
    for turn in range(6):
        for index, name in enumerate(world.assets):
            order(sim, name, "move_to", posts[(turn + index) % len(posts)], f"{turn}.{name}")
        for _ in range(40):
            run(sim, 0.5)
            assert {a.integrity for a in sim.picture().assets.values()} == {"ok"}


@given(
    history=st.lists(st.tuples(st.integers(1, 80), honest | commands()), min_size=1, max_size=10),
    seed=st.integers(0, 999),
)
@example(history=[(58, SetRadio()), (7, PlaceAsset(asset="Drone_T01", frame="Base"))], seed=0)
@settings(max_examples=40, deadline=None)
def test_no_honest_mishap_looks_like_a_forgery(
    world: World, history: list[tuple[int, Any]], seed: int
) -> None:
    sim = Checkpoint(world, seed)
    for moment in history:
        live_through(sim, [moment])
        assert {asset.integrity for asset in sim.picture().assets.values()} == {"ok"}


def test_honest_assets_are_not_suspect_after_a_long_silence(bare: Checkpoint) -> None:
    run(bare, 1.0)
    order(bare, "Drone_T01", "move_to", "EastGate")
    run(bare, 1.0)
    bare.inject(SetComms(asset="Drone_T01", comms="lost"))
    run(bare, 9.0)
    bare.inject(SetComms(asset="Drone_T01", comms="ok"))
    run(bare, 5.0)
    assert (of(bare, "Drone_T01").integrity, of(bare, "Drone_T01").at) == ("ok", "EastGate")


def test_an_asset_that_is_carried_elsewhere_is_no_forgery(bare: Checkpoint) -> None:
    run(bare, 5.0)
    bare.inject(PlaceAsset(asset="Ugv_T02", frame="WestGate"))
    run(bare, 1.0)
    assert (of(bare, "Ugv_T02").at, of(bare, "Ugv_T02").integrity) == ("WestGate", "ok")


def test_a_forgery_after_a_silence_is_found_only_by_another_sensor(
    bare: Checkpoint, watched: Checkpoint
) -> None:
    for sim, integrity in ((bare, "ok"), (watched, "suspect")):
        run(sim, 2.0)
        sim.inject(SetComms(asset="Drone_T04", comms="lost"))
        run(sim, 8.0)
        sim.inject(SetComms(asset="Drone_T04", comms="ok"))
        sim.inject(SpoofTelemetry(asset="Drone_T04", frame="EastGate"))
        run(sim, 5.0)
        assert of(sim, "Drone_T04").integrity == integrity
    watched.inject(SpoofTelemetry(asset="Drone_T04", frame=None))
    run(watched, 5.0)
    assert (of(watched, "Drone_T04").integrity, of(watched, "Drone_T04").at) == ("ok", "Checkpoint")


def test_a_broken_camera_is_no_witness(watched: Checkpoint) -> None:
    watched.inject(SensorFault(sensor="Cam_East"))
    run(watched, 2.0)
    watched.inject(SetComms(asset="Drone_T04", comms="lost"))
    run(watched, 8.0)
    watched.inject(SpoofTelemetry(asset="Drone_T04", frame="EastGate"))
    run(watched, 5.0)
    assert of(watched, "Drone_T04").integrity == "ok"


def test_a_uav_at_the_gate_sees_that_the_other_is_not_there(bare: Checkpoint) -> None:
    run(bare, 2.0)
    bare.inject(SetComms(asset="Ugv_T02", comms="lost"))
    run(bare, 30.0)
    bare.inject(SpoofTelemetry(asset="Ugv_T02", frame="NorthGate"))
    run(bare, 5.0)
    assert of(bare, "Ugv_T02").integrity == "suspect"
    assert bare.picture().gates["NorthGate"].unsure == ("Ugv_T02",)
