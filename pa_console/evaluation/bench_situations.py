"""Situations that the benchmark measures on, made from whatever world it is given."""

from pa_console.schema.incident import SetBattery, SpawnTrack
from pa_console.schema.plan import Action, Plan
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint

TRACK_AT_M = 30.0
LOW_PCT = 12.0


def busy_checkpoint(world: World, seed: int = 0) -> Checkpoint:
    """Return a checkpoint with an asset low on battery and, given a lane, a vehicle on it."""
    sim = Checkpoint(world, seed)
    sim.inject(SetBattery(asset=next(iter(world.assets)), percent=LOW_PCT))
    lane = next(iter(world.lanes.values()), None)
    if lane is not None:
        sim.inject(SpawnTrack(gate=lane.gate, distance_m=TRACK_AT_M))
    return sim


def gathering(world: World) -> Plan:
    """Send every asset that stands elsewhere to the first gate: a plan with much movement."""
    gate = world.gates[0]
    movers = [name for name, spec in world.assets.items() if spec.post != gate]
    actions = tuple(Action(agent=name, command=f"move_to {gate}") for name in movers[:64])
    return Plan(reason="everybody goes to one gate", actions=actions)
