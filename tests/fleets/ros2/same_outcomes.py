"""`python -m tests.fleets.ros2.same_outcomes`: missions over ROS 2 end as in one process."""

import argparse
import asyncio
import time
from collections.abc import Callable, Coroutine
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

from pa_console.evaluation import runner
from pa_console.evaluation.jobs import (
    Job,
    find_variant,
    keep_worlds,
    load_set,
    mission_file,
    plan_jobs,
)
from pa_console.evaluation.memo_engine import MemoEngine
from pa_console.evaluation.run_record import RunRecord
from pa_console.evaluation.score import idle_run
from pa_console.sim.checkpoint import Checkpoint
from pa_console.station.assembly import load_site
from tests.evaluation.witness_play import plans, written
from tests.fleets.ros2.simulated_nav2 import Nav2Fleet
from tests.scripted import ScriptedEngine, plan

OTHERWISE = (["Drone_T04 observe EastGate"],)
"""The plan for a mission that has none written by hand: those that are to be refused."""


async def made(job: Job) -> RunRecord:
    """Return the run of a mission with the plans that were written for it by hand."""
    todo = plans(written("*.yaml").get(job.case.id, OTHERWISE[0]))
    scripted = ScriptedEngine([plan(*((a.agent, a.command) for a in p.actions)) for p in todo])
    engine = MemoEngine(scripted.engine(), reuse=False)
    rules = runner.enforced_rules(job.site.rulebook)
    return await runner.make_run(
        job, engine, lambda: idle_run(job.case, job.site.world, job.seed, rules), None
    )


async def over_ros2(job: Job, folder: Path, layout: str) -> RunRecord:
    """Return the same run over ROS 2."""
    fleets: list[Nav2Fleet] = []

    def fleet(checkpoint: Checkpoint) -> Nav2Fleet:
        fleets.append(Nav2Fleet(checkpoint, folder, layout))
        return fleets[-1]

    try:
        with patch.object(runner, "SimulatedFleet", fleet):
            return await made(job)
    finally:
        for each in fleets:
            each.close()
            crashed = {n: r.crashed for n, r in each.site.robots.items() if r.crashed}
            assert not crashed, crashed


def outcome(run: RunRecord) -> tuple[object, ...]:
    """Return how a run ended."""
    return run.strict, run.status, run.verification, run.plan, run.broken


def compare(jobs: list[Job], other: Callable[[Job], Coroutine[None, None, RunRecord]]) -> int:
    """Print for every job how it ended in both; return how many had the same strict outcome."""
    same = 0
    for job in jobs:
        began = time.perf_counter()
        inside = asyncio.run(made(job))
        half = time.perf_counter()
        outside = asyncio.run(other(job))
        one, two = outcome(inside), outcome(outside)
        same += inside.strict == outside.strict
        took = f"{half - began:.1f} s, {time.perf_counter() - half:.1f} s"
        strict = f"strict {inside.strict}/{outside.strict}"
        print(f"{'same' if one == two else 'DIFFERS'} {job.case.id}: {strict} ({took})", flush=True)
        for run in (inside, outside) if one != two else ():
            print("  ", *outcome(run), run.failed, run.reason)
    return same


def main() -> None:
    """Run what was asked for and print what it came to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--set", default="paper")
    parser.add_argument("--only", default="", help="missions whose id contains this")
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--layout", default="bridge")
    given = parser.parse_args()
    site = load_site("checkpoint", "checkpoint")
    with TemporaryDirectory() as folder:
        path = mission_file(given.set, site.world_path)
        loaded = load_set(path, "checkpoint", site.rulebook, Path(folder))
        keep_worlds(loaded)
        jobs = plan_jobs([loaded], ["scripted"], [find_variant("one-plan")], [0])
        jobs = [job for job in jobs if given.only in job.case.id][:: given.every]
        same = compare(jobs, partial(over_ros2, folder=Path(folder), layout=given.layout))
        print(f"{same} of {len(jobs)} missions with the same strict outcome")


if __name__ == "__main__":
    main()
