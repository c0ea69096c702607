"""`python -m tests.fleets.same_outcomes`: missions over a bus end as they do in one process."""

import argparse
import asyncio
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import Mock, patch

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
from pa_console.llm.local.engine import Engine
from pa_console.llm.models.catalogue import find_model
from pa_console.station.assembly import load_site
from tests.fleets.broker import Broker, address_of, any_broker
from tests.fleets.conftest import joined, running


@contextmanager
def on_the_bus(job: Job, broker: Broker, number: int) -> Generator[None]:
    """Let the run of `job` drive a site on the bus, and score the truth of that site."""
    world, address = job.site.world, address_of(broker, f"outcomes{number}")
    with (
        running(world, address, seed=job.seed, paced=True) as service,
        joined(world, address) as fleet,
        patch.object(runner, "Checkpoint", Mock(return_value=service.site.checkpoint)),
        patch.object(runner, "SimulatedFleet", Mock(return_value=fleet)),
    ):
        yield


async def made(job: Job, engine: MemoEngine) -> RunRecord:
    enforced = runner.enforced_rules(job.site.rulebook)
    return await runner.make_run(
        job, engine, lambda: idle_run(job.case, job.site.world, job.seed, enforced), None
    )


async def compare(jobs: list[Job], broker: Broker) -> None:
    """Print for every job how it ended in one process and over the bus."""
    engine = MemoEngine(Engine(find_model(None)), reuse=False)
    same = 0
    for number, job in enumerate(jobs):
        began = time.perf_counter()
        inside = await made(job, engine)
        half = time.perf_counter()
        with on_the_bus(job, broker, number):
            outside = await made(job, engine)
        one, other = ((r.strict, r.status, r.plan) for r in (inside, outside))
        same += inside.strict == outside.strict
        mark = "same" if one == other else "DIFFERS"
        took = f"{half - began:.0f} s, {time.perf_counter() - half:.0f} s"
        print(f"{mark} {job.case.id}: {one}, over the bus {other} ({took})", flush=True)
    print(f"{same} of {len(jobs)} missions with the same strict outcome")
    await engine.close()


def main() -> None:
    """Run what was asked for and print what it came to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--set", default="paper")
    parser.add_argument("--only", default="", help="missions whose id or category contains this")
    parser.add_argument("--every", type=int, default=1)
    arguments = parser.parse_args()
    site = load_site("checkpoint", "checkpoint")
    with TemporaryDirectory() as folder:
        path = mission_file(arguments.set, site.world_path)
        loaded = load_set(path, "checkpoint", site.rulebook, Path(folder))
        keep_worlds(loaded)
        missions = chosen_missions(loaded.missions, arguments.only, arguments.every)
        assert missions is not None, "there is no such mission"
        loaded = type(loaded)(missions, loaded.sites)
        jobs = plan_jobs([loaded], ["default"], [find_variant("full")], [0])
        broker = any_broker()
        broker.start()
        try:
            asyncio.run(compare(jobs, broker))
        finally:
            broker.kill()


if __name__ == "__main__":
    main()
