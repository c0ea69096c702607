"""A rehearsal tells where everything was over time: enough to draw and to play it."""

import asyncio

import pytest

from pa_console.mission.examine import assume_done
from pa_console.mission.rehearse import rehearse
from pa_console.resources import find_data
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.world import Zone
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.worlds.world_file import load_world
from pa_console.station.assembly import load_site

SITE = load_site("checkpoint", "checkpoint")
MOVES = Plan(
    reason="",
    actions=(
        Action(agent="Drone_T04", command="move_to EastGate"),
        Action(agent="Ugv_T02", command="move_to WestGate"),
        Action(agent="Robot_T01", command="hold"),
    ),
)


def rehearsed(plan: Plan = MOVES) -> Rehearsal:
    sim = Checkpoint(SITE.world)
    for _ in range(100):
        sim.step()
    return asyncio.run(rehearse(sim, plan))


def test_ways_begin_where_an_asset_is_and_end_where_it_is_sent() -> None:
    done = rehearsed()
    for agent, gate in (("Drone_T04", "EastGate"), ("Ugv_T02", "WestGate")):
        way = done.motion.trajectories[agent]
        assert way[0] == pytest.approx((0.0, *done.before.assets[agent].position), abs=0.01)
        assert way[-1][1:] == pytest.approx(SITE.world.frames[gate].at, abs=3.0)
        assert [time_s for time_s, _, _ in way] == sorted({time_s for time_s, _, _ in way})


def test_what_stands_still_has_no_way() -> None:
    assert set(rehearsed().motion.trajectories) == {"Drone_T04", "Ugv_T02"}


def test_who_is_sent_arrives_before_the_command_ends() -> None:
    motion = rehearsed().motion
    assert set(motion.arrived_s) == {"Drone_T04", "Ugv_T02"}
    assert set(motion.ended_s) == set(MOVES.agents)
    for agent, time_s in motion.arrived_s.items():
        assert 0.0 < time_s <= motion.ended_s[agent]


def test_a_gate_gains_its_guard_when_that_arrives() -> None:
    motion = rehearsed().motion
    (first_s, first), (then_s, then) = motion.guards["EastGate"]
    assert (first_s, then_s) == (0.0, motion.arrived_s["Drone_T04"])
    assert set(then) - set(first) == {"Drone_T04"}
    assert len(motion.guards["NorthGate"]) == 1


def test_a_straight_way_takes_a_few_points_however_long_it_is() -> None:
    assert len(rehearsed().motion.trajectories["Drone_T04"]) <= 5


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
