"""Generated worlds are valid whatever is asked for, read back equal, and can be worked in."""

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pa_console.schema.world import AssetKind, World
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.worlds.terrain import Terrain
from pa_console.sim.worlds.world_file import load_world
from pa_console.sim.worlds.world_generator import MOST_GATES, generate_world, world_yaml
from tests.sim.running import order, run

SEEDS = st.integers(0, 10_000)


@given(gates=st.integers(1, 50), assets=st.integers(1, 120), seed=SEEDS)
@example(gates=50, assets=120, seed=1)
@example(gates=1, assets=1, seed=0)
@settings(max_examples=8, deadline=None)
def test_every_generated_world_loads_and_starts_with_its_gates_covered(
    gates: int, assets: int, seed: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    world = generate_world(gates, assets, seed)
    assert (len(world.gates), len(world.assets)) == (gates, assets)
    path = tmp_path_factory.mktemp("worlds") / "world.yaml"
    path.write_text(world_yaml(world), encoding="utf-8")
    assert load_world(path) == world
    posted = {spec.post for spec in world.assets.values()} & set(world.gates)
    assert assets < gates or posted == set(world.gates)
    picture = Checkpoint(world, seed).picture()
    assert {gate for gate, cover in picture.gates.items() if cover.covered} == posted


@given(gates=st.integers(1, 30), seed=SEEDS, data=st.data())
@settings(max_examples=10, deadline=None)
def test_every_gate_has_a_lane_and_a_camera_and_can_be_reached_with_room_for_several(
    gates: int, seed: int, data: st.DataObject
) -> None:
    world = generate_world(gates, 12, seed)
    assert {lane.gate for lane in world.lanes.values()} == set(world.gates)
    assert {camera.gate for camera in world.cameras.values()} == set(world.gates)
    terrain = Terrain(world)
    gate = data.draw(st.sampled_from(world.gates))
    kinds: tuple[AssetKind, ...] = ("uav", "ugv", "robot")
    for kind in kinds:
        for start in (world.base, next(n for n, f in world.frames.items() if f.kind == "post")):
            [here, *_] = terrain.places(start, kind)
            assert terrain.planner.route(kind, here, terrain.places(gate, kind)[0])
        assert len(terrain.places(gate, kind)) >= 6
        assert len(terrain.places(world.base, kind)) >= 12


def test_seeds_differ_and_equal_arguments_do_not() -> None:
    assert generate_world(4, 8, 1) == generate_world(4, 8, 1)
    worlds: list[World] = [generate_world(4, 8, seed) for seed in range(6)]
    assert len({world.perimeter for world in worlds}) == 6
    assert len({world.gates for world in worlds}) == 6
    assert len({len(world.perimeter) for world in worlds}) > 1


@pytest.mark.parametrize(("gates", "assets"), [(0, 5), (MOST_GATES + 1, 5), (4, 0), (4, 10**6)])
def test_numbers_out_of_range_are_refused(gates: int, assets: int) -> None:
    with pytest.raises(ValueError, match="out of range; it must be from 1 to"):
        generate_world(gates, assets, 0)


def test_a_large_generated_world_lives_and_forks_exactly() -> None:
    world = generate_world(12, 150, 3)
    sim, twin = Checkpoint(world, 1), Checkpoint(world, 1)
    for each in (sim, twin):
        for number, (name, spec) in enumerate(world.assets.items()):
            if spec.post not in world.gates and number % 3 == 0:
                order(each, name, "move_to", world.gates[number % 12], command_id=name)
        run(each, 10.0)
    fork = sim.fork()
    ends = {reply.command_id: reply.status for reply in run(sim, 30.0)}
    run(twin, 30.0)
    run(fork, 30.0)
    assert "done" in ends.values()
    assert sim.state_hash() == twin.state_hash() == fork.state_hash()
