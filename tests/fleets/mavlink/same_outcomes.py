"""`python -m tests.fleets.mavlink.same_outcomes`: missions end over MAVLink as in one process."""

import argparse
import asyncio
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

from pa_console.evaluation import runner
from pa_console.evaluation.jobs import (
    Job,
    chosen_missions,
    find_variant,
    keep_worlds,
    load_set,
    mission_file,
    plan_jobs,
)
from pa_console.evaluation.memo_engine import MemoEngine
from pa_console.evaluation.run_record import RunRecord
from pa_console.evaluation.score import idle_run
from pa_console.station.assembly import load_site
from tests.evaluation.witness_play import plans, written
from tests.fleets.mavlink.simulated_drones import DronesOverMavlink
from tests.scripted import ScriptedEngine, plan


async def made(job: Job) -> RunRecord:
    """Return the run of a mission with the plans that were written for it by hand."""
    todo = plans(written("*.yaml").get(job.case.id, []))
    answers = [plan(*((a.agent, a.command) for a in each.actions)) for each in todo]
    engine = MemoEngine(ScriptedEngine(answers or [plan()]).engine(), reuse=False)
    rules = runner.enforced_rules(job.site.rulebook)
    return await runner.make_run(
        job, engine, lambda: idle_run(job.case, job.site.world, job.seed, rules), None
    )


async def made_over_mavlink(job: Job) -> RunRecord:
    """Return the same with the drones on MAVLink."""
    with patch.object(runner, "SimulatedFleet", DronesOverMavlink):
        return await made(job)


def jobs_of(name: str, only: str, every: int, folder: Path) -> list[Job]:
    """Return the missions of a set, or every so many of them."""
    site = load_site("checkpoint", "checkpoint")
    path = mission_file(name, site.world_path)
    loaded = load_set(path, "checkpoint", site.rulebook, folder)
    keep_worlds(loaded)
    missions = chosen_missions(loaded.missions, only, every)
    assert missions is not None, "there is no such mission"
    loaded = type(loaded)(missions, loaded.sites)
    return plan_jobs([loaded], ["scripted"], [find_variant("one-plan")], [0])


async def compare(jobs: list[Job]) -> None:
    """Print for every job how it ended in one process and over MAVLink."""
    same = 0
    for job in jobs:
        began = time.perf_counter()
        inside = await made(job)
        outside = await made_over_mavlink(job)
        one, other = ((r.strict, r.status, r.plan, r.failed) for r in (inside, outside))
        same += inside.strict == outside.strict
        mark = "same" if one[:3] == other[:3] else "DIFFERS"
        took = f"{time.perf_counter() - began:.0f} s"
        print(f"{mark} {job.case.id}: {one[:2]}, over MAVLink {other[:2]} ({took})", flush=True)
        if one != other:
            print(f"   {one}\n   {other}", flush=True)
    print(f"{same} of {len(jobs)} missions with the same strict outcome", flush=True)


def main() -> None:
    """Run what was asked for and print what it came to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--set", default="paper")
    parser.add_argument("--only", default="", help="missions whose id or category contains this")
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--skip", type=int, default=0, help="so many of them at the beginning")
    arguments = parser.parse_args()
    with TemporaryDirectory() as folder:
        jobs = jobs_of(arguments.set, arguments.only, arguments.every, Path(folder))
        asyncio.run(compare(jobs[arguments.skip :]))


if __name__ == "__main__":
    main()
