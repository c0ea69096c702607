"""The simulation against the bare physics engine, and what forks and rehearsals cost."""

import asyncio
import copy
import math

import pymunk

from pa_console.mission.rehearse import device_commands, rehearse
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint
from tests.benchmarks.speed.compare import Bench, Comparison, alternate, compare
from tests.benchmarks.speed.measured_missions import busy_checkpoint, gathering

SIMULATED_S = 20.0
SLOWEST_MPS = 1.0


def measure_simulation(bench: Bench) -> list[Comparison]:
    """Compare SIMULATED_S seconds of the checkpoint with as many steps of a bare pymunk space.

    The space has the same walls and as many moving discs as the checkpoint has assets; it is the
    limit, as it knows no links, sensors, batteries or commands.
    """
    world = bench.site.world
    steps = round(SIMULATED_S / world.dt_s)
    standing = Checkpoint(world)
    moving = Checkpoint(world)
    for command in device_commands(gathering(world), "bench"):
        moving.send(command)
    found: list[Comparison] = []
    limit = f"limit: bare space.step, {len(world.assets)} bodies"
    for number, (name, sim) in enumerate((("standing", standing), ("on their way", moving))):
        bench.tell(f"assets {name}", number / 2)
        mine, theirs = alternate(
            bench.runs,
            (
                lambda sim=sim: _advance(sim.fork(), steps),
                lambda: _advance_space(bare_space(world), steps, world.dt_s),
            ),
        )
        times = SIMULATED_S / sorted(mine)[len(mine) // 2]
        found.append(
            compare(
                "simulation",
                f"{SIMULATED_S:.0f} s, {len(world.assets)} assets {name}",
                ("the checkpoint", mine),
                (limit, theirs),
                note=f"{times:,.0f} times real time",
            )
        )
    return found


def measure_rehearsal(bench: Bench) -> list[Comparison]:
    """Time a rehearsal and a telemetry picture; compare a fork with a deep copy."""
    world = bench.site.world
    sim, plan = busy_checkpoint(world), gathering(world)
    bench.tell("rehearsal", 0.0)
    duration_s = asyncio.run(rehearse(sim, plan)).timeline.duration_s
    (rehearsing,) = alternate(bench.runs, (lambda: asyncio.run(rehearse(sim, plan)),))
    bench.tell("fork", 0.7)
    forking, copying, twin = alternate(
        bench.runs, (sim.fork, lambda: copy.deepcopy(sim), sim.forecast)
    )
    name = f"rehearse {len(plan.actions)} commands, {duration_s:.0f} s"
    copied = ("copy.deepcopy of the simulation", copying)
    return [
        compare("rehearsal", name, ("in a forecast, every 0.5 s recorded", rehearsing)),
        compare("rehearsal", "fork the simulation", ("its own copy of the state", forking), copied),
        compare("rehearsal", "forecast from the picture", ("built from telemetry", twin), copied),
    ]


def bare_space(world: World) -> pymunk.Space:
    """Return a space with the walls of `world` and a moving disc for each of its assets."""
    space = pymunk.Space()
    for wall in world.walls:
        space.add(pymunk.Segment(space.static_body, wall.start, wall.end, wall.thickness_m / 2))
    for number, spec in enumerate(world.assets.values()):
        radius = world.platforms[spec.kind].radius_m
        body = pymunk.Body(1.0, pymunk.moment_for_circle(1.0, 0.0, radius))
        x, y = world.frames[spec.post].at
        body.position = x + 2.0 * number, y
        heading = 2.0 * math.pi * number / len(world.assets)
        body.velocity = SLOWEST_MPS * math.cos(heading), SLOWEST_MPS * math.sin(heading)
        space.add(body, pymunk.Circle(body, radius))
    return space


def _advance(sim: Checkpoint, steps: int) -> None:
    for _ in range(steps):
        sim.step()


def _advance_space(space: pymunk.Space, steps: int, dt_s: float) -> None:
    for _ in range(steps):
        space.step(dt_s)
