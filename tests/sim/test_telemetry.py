"""The picture: cover per gate, stamps, gaps, and incidents that name what exists."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.schema.incident import (
    ClearTracks,
    FailAsset,
    Incident,
    PlaceAsset,
    RestoreAsset,
    SetBattery,
    SetComms,
    SpawnTrack,
)
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint
from tests.sim.running import carry_out, order, run
from tests.sim.test_determinism import live_through, moments


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
