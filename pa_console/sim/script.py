"""What a scenario makes happen, and when."""

from pa_console.schema.incident import Incident
from pa_console.schema.scenario import Scenario
from pa_console.sim.state import Scene
from pa_console.sim.terrain import Terrain


def due(terrain: Terrain, scene: Scene, scenario: Scenario) -> list[Incident]:
    """Return what happens at this tick, in order; called once a tick from tick 0 on."""
    del terrain, scene, scenario
    return []


def apply(terrain: Terrain, scene: Scene, incident: Incident) -> bool:
    """Make an incident about the ground itself true; return whether it was one."""
    del terrain, scene, incident
    return False
