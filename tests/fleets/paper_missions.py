"""Runs the paper's missions with the default model, over links to robots that tests start."""

import argparse
import asyncio
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

from pa_console.evaluation import runner
from pa_console.evaluation.jobs import Job, find_variant
from pa_console.evaluation.memo_engine import MemoEngine
from pa_console.evaluation.score import idle_run
from pa_console.fleets.linked_fleet import LinkedFleet
from pa_console.llm.local.engine import Engine
from pa_console.llm.models.catalogue import find_model
from pa_console.sim.checkpoint import Checkpoint
from tests.fleets.mavlink.same_outcomes import jobs_of

FleetOf = Callable[[Job, Checkpoint], LinkedFleet]
"""Returns the fleet that carries a mission out; its checkpoint is the truth that is scored."""


async def carry_out(job: Job, engine: MemoEngine, fleet_of: FleetOf) -> bool:
    """Carry a mission out and print how it ended; return whether as the paper wants it."""
    began, rules = time.monotonic(), runner.enforced_rules(job.site.rulebook)
    print(f"{job.case.id}: {job.case.command}", flush=True)
    with patch.object(runner, "SimulatedFleet", partial(fleet_of, job)):
        record = await runner.make_run(
            job, engine, lambda: idle_run(job.case, job.site.world, job.seed, rules), None
        )
    mark = "as wanted" if record.strict else f"NOT as wanted {record.failed} {record.broken}"
    print(f"   plan: {', '.join(record.plan)}", flush=True)
    took = time.monotonic() - began
    print(f"{job.case.id}: {record.status}, {mark}, {took:.0f} s: {record.reason}", flush=True)
    return record.strict


async def carry_all_out(jobs: Sequence[Job], fleet_of: FleetOf) -> int:
    """Return how many missions ended as wanted, with the default model."""
    engine = MemoEngine(Engine(find_model(None)), reuse=False)
    good = 0
    try:
        for job in jobs:
            try:
                good += await carry_out(job, engine, fleet_of)
            except Exception as error:
                print(f"{job.case.id}: {type(error).__name__}: {error}", flush=True)
    finally:
        await engine.close()
    return good


def main(description: str | None, fleet_of: FleetOf) -> None:
    """Run the missions and print what they came to."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--only", default="", help="missions whose id contains this")
    arguments = parser.parse_args()
    with TemporaryDirectory() as folder:
        jobs = [
            replace(job, model=find_model(None).name, variant=find_variant("full"))
            for job in jobs_of("paper", arguments.only, 1, Path(folder))
        ]
        good = asyncio.run(carry_all_out(jobs, fleet_of))
        print(f"{good} of {len(jobs)} missions as wanted")
