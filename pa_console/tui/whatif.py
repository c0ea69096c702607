"""What can be made to happen in the simulation, and how fast it may run."""

from collections.abc import Iterator

from pa_console.schema.incident import (
    ClearTracks,
    FailAsset,
    Incident,
    RestoreAsset,
    SetBattery,
    SetComms,
    SpawnTrack,
)
from pa_console.schema.world import World

LOW_BATTERY_PCT = 15.0
RATES = (1.0, 2.0, 4.0, 8.0)
SLOW_RATES = (0.25, 0.5)


def next_rate(rate: float, factor: float, slow: bool) -> float:
    """Return the speed after one step; below real time only where `slow` allows it."""
    return min(max(rate * factor, SLOW_RATES[0] if slow else RATES[0]), RATES[-1])


def what_ifs(world: World) -> Iterator[tuple[str, Incident]]:
    """Yield every incident on offer with its title, the usual ones first."""
    for gate in world.gates:
        yield f"What if: unknown vehicle at {gate}", SpawnTrack(gate=gate)
    for asset in world.assets:
        yield f"What if: {asset} fails", FailAsset(asset=asset)
        yield f"What if: {asset} works again", RestoreAsset(asset=asset)
        yield f"What if: {asset} battery low", SetBattery(asset=asset, percent=LOW_BATTERY_PCT)
        yield f"What if: {asset} battery full", SetBattery(asset=asset, percent=100.0)
        yield f"What if: {asset} link degraded", SetComms(asset=asset, comms="degraded")
        yield f"What if: {asset} link lost", SetComms(asset=asset, comms="lost")
        yield f"What if: {asset} link ok", SetComms(asset=asset, comms="ok")
    for gate in world.gates:
        yield (
            f"What if: hostile vehicle at {gate} that ignores warnings",
            SpawnTrack(gate=gate, intent="hostile", when_warned="go_on"),
        )
        yield (
            f"What if: authorized vehicle at {gate}",
            SpawnTrack(gate=gate, identity="authorized"),
        )
        yield f"What if: person at {gate}", SpawnTrack(gate=gate, track="person", speed_mps=1.4)
        yield f"What if: tracks at {gate} are gone", ClearTracks(gate=gate)
