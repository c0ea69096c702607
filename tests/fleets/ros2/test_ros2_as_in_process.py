"""A mission of the paper ends over ROS 2 as it does in one process."""

from pathlib import Path

import pytest

from pa_console.evaluation.jobs import find_variant, load_set, mission_file, plan_jobs
from pa_console.station.assembly import load_site
from tests.fleets.ros2.same_outcomes import made, over_ros2


@pytest.mark.parametrize(
    ("mission", "layout"), [("P01", "rmw"), ("P04", "bridge"), ("P08", "rmw")]
)  # a hold of all, two drones to observe, and a vehicle that fills a gap
async def test_the_strict_outcome_is_the_same(mission: str, layout: str, tmp_path: Path) -> None:
    site = load_site("checkpoint", "checkpoint")
    path = mission_file("paper", site.world_path)
    loaded = load_set(path, "checkpoint", site.rulebook, tmp_path)
    jobs = plan_jobs([loaded], ["scripted"], [find_variant("one-plan")], [0])
    (job,) = (job for job in jobs if job.case.id == mission)
    inside, outside = await made(job), await over_ros2(job, tmp_path, layout)
    assert inside.strict, inside.failed
    assert outside.strict, (outside.failed, outside.reason)
    assert outside.plan == inside.plan
