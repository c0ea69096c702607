"""A sweep on Dask comes to what a single run does, though workers die and schedulers restart."""

import os
import signal
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, cast

import pytest
from distributed import Scheduler, Worker

from pa_console.evaluation.jobs import Job
from pa_console.evaluation.memo_engine import MemoEngine
from pa_console.evaluation.run_record import EvaluationFolder, RunRecord, read_runs
from pa_console.evaluation.runner import Runner
from pa_console.evaluation.sweep import RemoteRun, Sweep, SweepError, Workers, cluster
from pa_console.station.assembly import Site
from tests.evaluation.test_runner import SEND, SPARE, jobs
from tests.scripted import ScriptedEngine

PRINTS = {"scripted": "0" * 64}


def scripted_engine(_model: str, _lane: int = 0) -> MemoEngine:
    return MemoEngine(ScriptedEngine([SPARE]).engine(), reuse=False)


def drone_jobs(site: Site, number: int) -> list[Job]:
    """Return runs of the same mission, watched for a short and a long time in turn."""
    cases = [
        SEND.model_copy(update={"id": f"C{n}", "watch_s": 5.0 + 10.0 * (n % 2)})
        for n in range(number)
    ]
    return jobs(site, *cases)


async def single(folder: Path, planned: list[Job]) -> list[RunRecord]:
    results = EvaluationFolder(folder)
    made = [record async for record in Runner(results, scripted_engine).run(planned)]
    assert len(made) == len(planned)
    return read_runs(folder)


MEASURED = {"session", "metrics", "planner", "judge", "reused"}
"""The fields that differ between equal runs: times, and drawn names."""


def told(record: RunRecord) -> dict[str, object]:
    """Return what a run says whatever the machine, at any speed."""
    return record.model_dump(exclude=MEASURED)


def same(made: list[RunRecord], expected: list[RunRecord]) -> bool:
    pairs = zip(made, expected, strict=True)
    return all(told(one) == told(other) for one, other in pairs)


async def test_two_workers_one_of_them_killed_come_to_what_one_process_does(
    tmp_path: Path, site: Site
) -> None:
    planned = drone_jobs(site, 8)
    results = EvaluationFolder(tmp_path / "swept")
    sweep = Sweep(results, scripted_engine, PRINTS)
    killed = 0
    async with cluster(Workers(count=2)) as target:
        async for _ in sweep.run_on(target, planned):
            if not killed:
                killed = target.workers[0].pid
                os.kill(killed, signal.SIGKILL)
    assert killed
    made = read_runs(tmp_path / "swept")
    assert same(made, await single(tmp_path / "single", planned))
    assert all((tmp_path / "swept" / record.log).stat().st_size for record in made)


@asynccontextmanager
async def scheduling(port: int = 0) -> AsyncGenerator[str]:
    """A scheduler with one worker in this process."""
    options: dict[str, Any] = {"dashboard": False, "host": "127.0.0.1", "port": port}
    async with (
        cast(Any, Scheduler)(**options) as scheduler,
        cast(Any, Worker)(scheduler.address, nthreads=1, dashboard=False),
    ):
        yield str(scheduler.address)


async def test_a_scheduler_that_is_restarted_is_sent_what_is_missing(
    tmp_path: Path, site: Site
) -> None:
    planned = drone_jobs(site, 4)
    said: list[str] = []
    results = EvaluationFolder(tmp_path / "swept")
    sweep = Sweep(results, scripted_engine, PRINTS, report=said.append, again_s=0.001)
    made: list[RunRecord] = []
    first = scheduling()
    address = await first.__aenter__()
    records = sweep.run_on(address, planned)
    made.append(await anext(records))
    await first.__aexit__(None, None, None)
    async with scheduling(int(address.rpartition(":")[2])):
        made += [record async for record in records]
    assert len(made) == len({record.run for record in made}) == 4
    assert any("submitted again" in text for text in said)
    assert same(read_runs(tmp_path / "swept"), await single(tmp_path / "single", planned))


async def test_an_address_at_which_there_is_no_scheduler_is_told(
    tmp_path: Path, site: Site
) -> None:
    sweep = Sweep(EvaluationFolder(tmp_path), scripted_engine, PRINTS)
    with pytest.raises(SweepError, match="no scheduler answers at tcp"):
        _ = [record async for record in sweep.run_on("tcp://127.0.0.1:1", drone_jobs(site, 1))]


async def test_what_is_there_is_not_made_again(tmp_path: Path, site: Site) -> None:
    planned = drone_jobs(site, 2)
    await single(tmp_path, planned)
    sweep = Sweep(EvaluationFolder(tmp_path), scripted_engine, PRINTS)
    assert [record async for record in sweep.run_on("tcp://127.0.0.1:1", planned)] == []


def test_a_run_has_one_key_and_another_rule_file_another(tmp_path: Path, site: Site) -> None:
    job = drone_jobs(site, 1)[0]
    one = RemoteRun.of(job, "f", keep_log=True)
    assert one.key == RemoteRun.of(job, "f", keep_log=True).key
    assert one.key != RemoteRun.of(job, "other weights", keep_log=True).key
    assert one.key.startswith(job.run)


async def test_the_file_does_not_depend_on_who_was_first(tmp_path: Path, site: Site) -> None:
    planned = drone_jobs(site, 2)
    await single(tmp_path, planned)
    results = EvaluationFolder(tmp_path)
    before = (tmp_path / "runs.jsonl").read_bytes()
    results.arrange([job.run for job in reversed(planned)])
    assert (tmp_path / "runs.jsonl").read_bytes() != before
    results.arrange([job.run for job in planned])
    assert (tmp_path / "runs.jsonl").read_bytes() == before
