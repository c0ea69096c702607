"""What is taken to come of a plan that is not rehearsed."""

from pa_console.mission.examine import assume_done
from pa_console.resources import find_data
from pa_console.schema.plan import Action, Plan
from pa_console.schema.world import Zone
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.worlds.world_file import load_world

WORLD = load_world(find_data("worlds", "checkpoint", "world.yaml"))


def test_who_is_sent_into_a_zone_has_entered_it() -> None:
    yard = Zone(kind="restricted", polygon=((-60, -10), (-40, -10), (-40, 10), (-60, 10)))
    world = WORLD.model_copy(update={"zones": {**WORLD.zones, "Yard": yard}})
    sent = Plan(
        reason="",
        actions=(
            Action(agent="Robot_T01", command="move_to WestGate"),
            Action(agent="Drone_T04", command="move_to NorthGate"),
        ),
    )
    assets = assume_done(Checkpoint(world).picture(), world, sent).timeline.assets
    assert assets["Robot_T01"].entered_zones == ("Yard",)
    assert assets["Drone_T04"].entered_zones == ()
