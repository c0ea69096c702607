"""A whole station with its drones on MAVLink: a mission, and a stop with one link dead."""

from pathlib import Path

from pa_console.schema.world import World
from tests.fleets.mavlink.campaign import TEAM, stop_with_a_dead_link
from tests.fleets.mavlink.drones import on_the_earth
from tests.fleets.mavlink.same_outcomes import jobs_of, made, made_over_mavlink


async def test_a_mission_of_the_paper_ends_as_in_one_process(tmp_path: Path) -> None:
    (job,) = jobs_of("paper", "P01", 1, tmp_path)
    inside, outside = await made(job), await made_over_mavlink(job)
    assert inside.strict, inside.failed
    assert (outside.strict, outside.status, outside.plan) == (
        inside.strict, inside.status, inside.plan
    ), outside.failed  # fmt: skip


def test_a_stop_that_one_link_does_not_confirm_is_not_confirmed(world: World) -> None:
    standing, doubts = stop_with_a_dead_link(on_the_earth(world))
    assert standing == [*TEAM[:2]]
    assert set(doubts) == {*TEAM[2:]}
    assert set(doubts.values()) == {"no answer"}
