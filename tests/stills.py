"""A simulated vehicle at the north gate, and what the camera there sees of it."""

import hashlib
from functools import cache
from pathlib import Path

from pa_console.fleets.simulated import SimulatedFleet
from pa_console.schema.events.event import CameraStill
from pa_console.schema.incident import Incident, SpawnTrack
from pa_console.session.stills import keep_still
from pa_console.sim.worlds.world_file import open_world

CAMERA = "NorthCamera"
VEHICLE = SpawnTrack(gate="NorthGate", distance_m=40.0)


def fleet_with(*incidents: Incident, seed: int = 7, seconds: float = 6.0) -> SimulatedFleet:
    """Return the default checkpoint some seconds after `incidents`."""
    world, _ = open_world("checkpoint")
    fleet = SimulatedFleet.start(world, seed)
    for incident in incidents:
        fleet.inject(incident)
    for _ in range(round(seconds / world.dt_s)):
        fleet.step()
    return fleet


@cache
def drawn() -> bytes:
    """Return what the north camera sees of a vehicle."""
    make = fleet_with(VEHICLE).still(CAMERA, "Track_01")
    assert make is not None
    return make()


def kept(log: Path, track: str, taken_s: float = 296.0) -> CameraStill:
    """Return a picture of `track` whose file is beside `log`."""
    sha256 = hashlib.sha256(drawn()).hexdigest()
    still = CameraStill(track=track, camera=CAMERA, taken_s=taken_s, sha256=sha256)
    keep_still(log, drawn(), still)
    return still
