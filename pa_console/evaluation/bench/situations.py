"""Situations that the benchmark measures on, made from whatever world it is given."""

from pa_console.orchestrator.headless import SETUP_SETTLE_S
from pa_console.schema.incident import SetBattery, SpawnTrack
from pa_console.schema.plan import Action, Plan
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint

TRACK_AT_M = 40.0
LOW_PCT = 12.0


def busy_checkpoint(world: World) -> Checkpoint:
    """Return a checkpoint with an asset low on battery and, given a lane, a vehicle in sight."""
    sim = Checkpoint(world)
    sim.inject(SetBattery(asset=next(iter(world.assets)), percent=LOW_PCT))
    bring_vehicle(sim)
    return sim


def bring_vehicle(sim: Checkpoint) -> str | None:
    """Let an unknown vehicle come up the first lane until sensors have seen it; return its gate."""
    lane = next(iter(sim.world.lanes.values()), None)
    if lane is None:
        return None
    sim.inject(SpawnTrack(gate=lane.gate, distance_m=TRACK_AT_M))
    for _ in range(round(SETUP_SETTLE_S / sim.world.dt_s)):
        sim.step()
    return lane.gate


def gathering(world: World) -> Plan:
    """Send every asset that stands elsewhere to the first gate: a plan with much movement."""
    gate = world.gates[0]
    movers = [name for name, spec in world.assets.items() if spec.post != gate]
    actions = tuple(Action(agent=name, command=f"move_to {gate}") for name in movers[:64])
    return Plan(reason="everybody goes to one gate", actions=actions)
