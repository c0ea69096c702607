"""Equal seeds and equal inputs give equal worlds, and a fork is exact, contacts included."""

import math
import subprocess
import sys
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.schema.command import COMMANDS, DeviceCommand
from pa_console.schema.incident import (
    DegradeAsset,
    FailAsset,
    GpsDrift,
    Incident,
    JamArea,
    PlaceAsset,
    Reaction,
    RestoreAsset,
    SetBattery,
    SetComms,
    SetRadio,
    SpawnTrack,
    SpoofTelemetry,
)
from pa_console.schema.world import World
from pa_console.sim import motion
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.scene import AssetState
from pa_console.sim.worlds.terrain import Terrain
from tests.sim.running import order, run

AGENTS = ["Drone_T01", "Drone_T04", "Ugv_T01", "Ugv_T02", "Robot_T01", "Robot_T02"]
FRAMES = ["NorthGate", "EastGate", "SouthGate", "WestGate", "Checkpoint", "Base"]
GATES = FRAMES[:4]

agents = st.sampled_from(AGENTS)


REACTIONS: st.SearchStrategy[Reaction] = st.sampled_from(("leave", "stop", "go_on"))


@st.composite
def commands(draw: st.DrawFn) -> DeviceCommand:
    verb = draw(st.sampled_from(list(COMMANDS)))
    return DeviceCommand(
        command_id=str(draw(st.integers(0, 10_000))),
        agent=draw(agents),
        verb=verb,
        target=draw(st.sampled_from(FRAMES)) if COMMANDS[verb].takes_frame else None,
    )


honest: st.SearchStrategy[Incident] = st.one_of(
    st.builds(SpawnTrack, gate=st.sampled_from(GATES), when_warned=REACTIONS),
    st.builds(FailAsset, asset=agents),
    st.builds(RestoreAsset, asset=agents),
    st.builds(SetBattery, asset=agents, percent=st.floats(0, 100)),
    st.builds(SetComms, asset=agents, comms=st.sampled_from(["ok", "degraded", "lost"])),
    st.builds(PlaceAsset, asset=agents, frame=st.sampled_from(FRAMES)),
    st.builds(DegradeAsset, asset=agents, speed_factor=st.floats(0.1, 1.0)),
    st.builds(SetRadio, asset=st.none() | agents, loss=st.floats(0, 1), up=st.booleans()),
    st.builds(JamArea, at=st.just((0.0, 0.0)), radius_m=st.floats(1, 90), seconds=st.just(5.0)),
)
incidents: st.SearchStrategy[Incident] = st.one_of(
    honest,
    st.builds(GpsDrift, asset=agents, rate_mps=st.floats(0, 9), heading_deg=st.floats(0, 360)),
    st.builds(SpoofTelemetry, asset=agents, frame=st.none() | st.sampled_from(FRAMES)),
)
moments = st.lists(
    st.tuples(st.integers(1, 60), st.one_of(commands(), incidents)), min_size=1, max_size=8
)


def live_through(sim: Checkpoint, history: list[tuple[int, Any]]) -> None:
    for steps, happening in history:
        if isinstance(happening, DeviceCommand):
            sim.send(happening)
        else:
            sim.inject(happening)
        for _ in range(steps):
            sim.step()


@given(past=moments, future=moments, seed=st.integers(0, 2**32))
@settings(max_examples=40, deadline=None)
def test_twins_and_forks_stay_equal(
    world: World, past: list[tuple[int, Any]], future: list[tuple[int, Any]], seed: int
) -> None:
    sim, twin = Checkpoint(world, seed), Checkpoint(world, seed)
    live_through(sim, past)
    live_through(twin, past)
    assert sim.state_hash() == twin.state_hash()
    fork = sim.fork()
    before = sim.state_hash()
    live_through(fork, future)
    assert sim.state_hash() == before
    live_through(sim, future)
    live_through(twin, future)
    assert sim.state_hash() == fork.state_hash() == twin.state_hash()
    assert sim.picture() == fork.picture()


def test_forks_taken_in_the_middle_of_a_collision_stay_equal(
    crossing: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    def blind(
        terrain: Terrain, asset: AssetState, ground: list[AssetState], wanted: float
    ) -> float:
        return wanted

    monkeypatch.setattr(motion, "give_way", blind)
    sim = Checkpoint(crossing.model_copy(update={"telemetry_period_s": 0.1}))
    order(sim, "Left", "move_to", "West")
    order(sim, "Right", "move_to", "East")
    hulls = 2 * crossing.platforms["ugv"].radius_m
    touching: list[tuple[int, Checkpoint]] = []
    for _ in range(400):
        sim.step()
        assets = sim.picture().assets
        gap = math.dist(assets["Left"].position, assets["Right"].position)
        assert gap > hulls - 0.2
        if gap < hulls + 0.01 and sim.tick % 4 == 0:
            touching.append((sim.tick, sim.fork()))
    assert len(touching) > 5
    end = sim.state_hash()
    for tick, fork in touching:
        for _ in range(400 - tick):
            fork.step()
        assert fork.state_hash() == end, f"forked at tick {tick}"


def test_reset_begins_anew(sim: Checkpoint) -> None:
    fresh = sim.state_hash()
    sim.inject(SpawnTrack(gate="WestGate"))
    order(sim, "Ugv_T02", "move_to", "NorthGate")
    run(sim, 5.0)
    assert sim.state_hash() != fresh
    sim.reset(1)
    assert (sim.tick, sim.time_s) == (0, 0.0)
    assert sim.state_hash() == fresh


def test_another_seed_is_another_history(world: World) -> None:
    histories: list[list[float]] = []
    for seed in (1, 2):
        sim = Checkpoint(world, seed)
        sim.inject(SetComms(asset="Drone_T01", comms="degraded"))
        histories.append([])
        for _ in range(300):
            sim.step()
            histories[-1].append(sim.picture().assets["Drone_T01"].stamp_s)
    assert histories[0] != histories[1]


def test_a_module_level_simulation_exits_cleanly() -> None:
    code = (
        "from pathlib import Path\n"
        "from pa_console.resources import find_data\n"
        "from pa_console.schema.command import DeviceCommand\n"
        "from pa_console.schema.incident import JamArea, SensorFault, SetRadio\n"
        "from pa_console.schema.incident import ClearTracks, SensorFault, SpawnTrack\n"
        "from pa_console.sim.checkpoint import Checkpoint\n"
        "from pa_console.sim.worlds.world_file import load_world\n"
        "sim = Checkpoint(load_world(find_data('worlds', 'checkpoint', 'world.yaml')))\n"
        "for n, agent in enumerate(('Ugv_T02', 'Robot_T01')):\n"
        "    sim.send(DeviceCommand(command_id=str(n), agent=agent, verb='move_to',"
        " target='EastGate'))\n"
        "for sensor in ('Drone_T02', 'Ugv_T01', 'Robot_T02'):\n"
        "    sim.inject(SensorFault(sensor=sensor))\n"
        "for gate in sim.world.gates:\n"
        "    sim.inject(SpawnTrack(gate=gate)); sim.inject(ClearTracks(gate=gate))\n"
        "for name in sim.world.cameras: sim.inject(SensorFault(sensor=name))\n"
        "sim.inject(JamArea(at=(0.0, 0.0), radius_m=30.0))\n"
        "sim.inject(SetRadio(loss=0.3))\n"
        "for _ in range(300): sim.step()\n"
        "print(sim.state_hash())\n"
    )
    runs = [
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
        for _ in range(2)
    ]
    assert [run.returncode for run in runs] == [0, 0], runs[0].stderr
    assert runs[0].stdout == runs[1].stdout
