"""The picture: cover per gate, stamps, gaps, and incidents that name what exists."""

from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pa_console.schema.incident import (
    ClearTracks,
    FailAsset,
    GpsDrift,
    Incident,
    PlaceAsset,
    RestoreAsset,
    SensorFault,
    SetBattery,
    SetComms,
    SetRadio,
    SpawnTrack,
    SpoofTelemetry,
)
from pa_console.schema.telemetry import AssetTelemetry, Picture
from pa_console.schema.world import Camera, World
from pa_console.sim.checkpoint import Checkpoint
from tests.sim.running import carry_out, order, run
from tests.sim.test_determinism import commands, honest, live_through, moments


def test_every_gate_is_covered_at_the_start(sim: Checkpoint) -> None:
    picture = sim.picture()
    assert {gate: cover.by for gate, cover in picture.gates.items()} == {
        "NorthGate": ("Drone_T02",),
        "EastGate": ("Ugv_T01",),
        "SouthGate": ("Drone_T03",),
        "WestGate": ("Drone_T01",),
    }
    assert all(asset.at == asset.post for asset in picture.assets.values())
    assert all(asset.available for asset in picture.assets.values())


def test_a_gate_is_lost_when_its_asset_is_sent_away_and_the_gap_grows(sim: Checkpoint) -> None:
    order(sim, "Drone_T01", "move_to", "NorthGate")
    run(sim, 1.0)
    assert not sim.picture().gates["WestGate"].covered
    run(sim, 10.0)
    assert 9.0 < sim.picture().gates["WestGate"].uncovered_s < 11.5
    carry_out(sim, "Drone_T01", "move_to", "WestGate")
    cover = sim.picture().gates["WestGate"]
    assert (cover.by, cover.uncovered_s) == (("Drone_T01",), 0.0)


def test_passing_by_does_not_cover(sim: Checkpoint) -> None:
    sim.inject(FailAsset(asset="Ugv_T01"))
    sim.inject(PlaceAsset(asset="Drone_T04", frame="EastGate"))
    assert sim.picture().gates["EastGate"].by == ("Drone_T04",)
    order(sim, "Drone_T04", "move_to", "WestGate")
    run(sim, 0.5)
    picture = sim.picture()
    assert picture.assets["Drone_T04"].at == "EastGate"
    assert not picture.gates["EastGate"].covered


@pytest.mark.parametrize(
    "incident",
    [
        FailAsset(asset="Drone_T01"),
        SetBattery(asset="Drone_T01", percent=0.0),
        SetComms(asset="Drone_T01", comms="lost"),
    ],
)
def test_an_unavailable_asset_does_not_cover(sim: Checkpoint, incident: Incident) -> None:
    sim.inject(incident)
    assert not sim.picture().assets["Drone_T01"].available
    assert not sim.picture().gates["WestGate"].covered


def test_a_restored_asset_covers_again(sim: Checkpoint) -> None:
    sim.inject(FailAsset(asset="Drone_T01"))
    run(sim, 3.0)
    assert not sim.picture().gates["WestGate"].covered
    sim.inject(RestoreAsset(asset="Drone_T01"))
    assert not sim.picture().gates["WestGate"].covered, "nobody has told the station yet"
    run(sim, 1.0)
    assert sim.picture().gates["WestGate"].by == ("Drone_T01",)


def test_telemetry_comes_every_period(sim: Checkpoint) -> None:
    times, ages = set[float](), set[float]()
    for _ in range(20):
        sim.step()
        picture = sim.picture()
        times.add(picture.time_s)
        ages.add(round(picture.time_s - picture.assets["Drone_T01"].stamp_s, 6))
    assert times == {0.0, 0.5, 1.0, 1.5, 2.0}
    assert ages == {0.0, 0.2}, "sent two steps before the picture, so that it arrives in time"


def test_a_picture_is_a_valid_document(sim: Checkpoint) -> None:
    sim.inject(SetComms(asset="Drone_T01", comms="lost"))
    sim.inject(SetBattery(asset="Drone_T02", percent=3.0))
    run(sim, 5.0)
    for picture in (sim.picture(), sim.truth(), sim.forecast().picture()):
        assert Picture.model_validate_json(picture.model_dump_json()) == picture


def test_telemetry_tells_of_incidents_only_when_reports_arrive(sim: Checkpoint) -> None:
    run(sim, 2.0)
    before = sim.picture()
    sim.inject(FailAsset(asset="Drone_T01"))
    sim.inject(SetBattery(asset="Drone_T02", percent=10.0))
    assert sim.picture() is before
    assert sim.truth().assets["Drone_T01"].status == "failed"
    run(sim, 0.5)
    assets = sim.picture().assets
    assert (assets["Drone_T01"].status, assets["Drone_T01"].comms) == ("failed", "ok")
    assert assets["Drone_T02"].low_battery


def test_what_is_set_up_before_the_first_step_has_long_been_so(sim: Checkpoint) -> None:
    sim.inject(SetComms(asset="Drone_T01", comms="lost"))
    sim.inject(SetComms(asset="Drone_T02", comms="degraded"))
    assets = sim.picture().assets
    assert (assets["Drone_T01"].comms, assets["Drone_T01"].stale) == ("lost", True)
    assert (assets["Drone_T02"].comms, assets["Drone_T02"].available) == ("degraded", True)


def test_the_truth_covers_what_the_station_cannot_know(sim: Checkpoint) -> None:
    sim.inject(SetComms(asset="Drone_T01", comms="lost"))
    run(sim, 2.0)
    known, true = sim.picture().gates["WestGate"], sim.truth().gates["WestGate"]
    assert (known.covered, known.unsure, known.unknown) == (False, ("Drone_T01",), True)
    assert known.uncovered_s == 2.0
    assert (true.covered, true.by, true.uncovered_s) == (True, ("Drone_T01",), 0.0)


@pytest.mark.parametrize(
    ("incident", "named"),
    [
        (FailAsset(asset="Tank"), "Drone_T01"),
        (RestoreAsset(asset="Tank"), "Drone_T01"),
        (SetBattery(asset="Tank", percent=1.0), "Drone_T01"),
        (SetComms(asset="Tank", comms="ok"), "Drone_T01"),
        (PlaceAsset(asset="Tank", frame="Base"), "Drone_T01"),
        (PlaceAsset(asset="Drone_T01", frame="Moon"), "Checkpoint"),
        (SpawnTrack(gate="Base"), "NorthGate"),
        (ClearTracks(gate="Moon"), "NorthGate"),
    ],
)
def test_incidents_on_unknown_names_say_what_exists(
    sim: Checkpoint, incident: Incident, named: str
) -> None:
    before = sim.state_hash()
    with pytest.raises(ValueError, match=named):
        sim.inject(incident)
    assert sim.state_hash() == before


def test_a_track_needs_a_lane(world: World) -> None:
    lanes = {name: lane for name, lane in world.lanes.items() if lane.gate != "SouthGate"}
    sim = Checkpoint(world.model_copy(update={"lanes": lanes}))
    with pytest.raises(ValueError, match=r"no lane leads to 'SouthGate'.*NorthGate"):
        sim.inject(SpawnTrack(gate="SouthGate"))


@given(history=moments, seed=st.integers(0, 999))
@settings(max_examples=30, deadline=None)
def test_no_picture_claims_more_than_its_reports_say(
    world: World, history: list[tuple[int, Any]], seed: int
) -> None:
    sim = Checkpoint(world, seed)
    last = sim.picture()
    for steps, happening in history:
        live_through(sim, [(0, happening)])
        for _ in range(steps):
            sim.step()
            now = sim.picture()
            if now is not last:
                _check(world, last, now)
                last = now


def _check(world: World, last: Picture, now: Picture) -> None:
    for name, asset in now.assets.items():
        age_s = round(now.time_s - asset.stamp_s, 6)
        assert asset.stamp_s >= last.assets[name].stamp_s
        assert asset.stale or age_s <= world.stale_s
        assert asset.comms == "lost" or age_s < world.link_lost_s
        doubtful = asset.stale or asset.comms == "lost" or asset.integrity == "suspect"
        assert asset.available == (asset.status != "failed" and not doubtful)
    for gate, cover in now.gates.items():
        there = [a for a in now.assets.values() if a.post == a.at == gate]
        assert cover.by == tuple(a.id for a in there if a.available)
        assert cover.unsure == tuple(
            a.id for a in there if not a.available and a.status != "failed"
        )
        assert cover.covered == bool(cover.by)
        assert not cover.covered or cover.uncovered_s == 0.0
        before = last.gates[gate]
        if not cover.covered and not before.covered:
            passed = now.time_s - last.time_s
            assert cover.uncovered_s == pytest.approx(before.uncovered_s + passed)


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
