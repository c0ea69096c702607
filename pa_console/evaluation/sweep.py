"""The runs of an evaluation on the workers of a Dask scheduler; imported only for a sweep.

The world, rules and mission of a run are sent as text, so that a worker on any machine can make the
run. A run that is submitted twice is made once, because its key is the same. If a worker dies, its
run moves to another worker. If the scheduler restarts, the unfinished runs are submitted again.
"""

import asyncio
import hashlib
import json
import logging
import signal
import socket
from collections.abc import AsyncGenerator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Lock, Thread
from typing import Any, cast

from distributed import Client, LocalCluster, WorkerPlugin, as_completed, get_worker
from distributed.scheduler import KilledWorker

from pa_console import __version__
from pa_console.child_processes import isolated_workers
from pa_console.evaluation.jobs import Job
from pa_console.evaluation.memo_engine import MemoEngine
from pa_console.evaluation.run_record import LOGS, EvaluationFolder, RunRecord
from pa_console.evaluation.runner import idle_score, in_order, make_run
from pa_console.llm.backend import ModelError
from pa_console.llm.local.engine import Engine
from pa_console.llm.local.threads import physical_cores
from pa_console.llm.models.catalogue import find_model
from pa_console.schema.document import read_text
from pa_console.schema.evaluation import MissionCase, Variant
from pa_console.station.assembly import Site, load_site

AWAY_S = 600.0
"""The longest time for which the sweep waits for an unreachable scheduler, in seconds."""
AGAIN_S = 2.0
"""The time between two attempts to reach the scheduler, in seconds."""
PLUGIN = "pa-console runs"
"""The name of the plugin on the scheduler."""

EngineFor = Callable[[str], MemoEngine]
"""A function that is sent to the workers; on a worker, it returns the engine of a named model."""


class SweepError(ValueError):
    """The error of a sweep that cannot continue; its results are kept, and it can be resumed."""


@dataclass(frozen=True)
class Workers:
    """The workers of the scheduler at the address `scheduler`, or `count` local processes."""

    scheduler: str = ""
    count: int = 0


@dataclass(frozen=True)
class RemoteRun:
    """A job in the form that is sent to a worker; `world` and `rules` are texts of files."""

    run: str
    stem: str
    mission_set: str
    case: MissionCase
    world: str
    rules: str
    model: str
    fingerprint: str
    variant: Variant
    seed: int
    keep_log: bool

    @classmethod
    def of(cls, job: Job, fingerprint: str, *, keep_log: bool) -> "RemoteRun":
        """Return `job` in the form for a worker; raises SweepError if its rules have no file."""
        if job.site.rules_path is None:
            raise SweepError("a sweep needs rules from a file")
        return cls(
            job.run,
            job.stem,
            job.mission_set,
            job.case,
            read_text(job.site.world_path),
            read_text(job.site.rules_path),
            job.model,
            fingerprint,
            job.variant,
            job.seed,
            keep_log,
        )

    @property
    def key(self) -> str:
        """The key of the run on the scheduler: its id, and a hash of all that it depends on."""
        parts = (
            __version__,
            self.world,
            self.rules,
            self.fingerprint,
            self.case.model_dump_json(),
            self.variant.model_dump_json(),
            str(self.keep_log),
        )
        return f"{self.run}-{hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:16]}"


@dataclass(frozen=True)
class MadeRun:
    """The record of a run and its event log."""

    record: RunRecord
    log: bytes | None


class RunMaker(WorkerPlugin):
    """The plugin that makes runs on a worker, one at a time, in its own event loop.

    Each worker receives the plugin once. The plugin keeps engines and sites from run to run.
    """

    name = PLUGIN

    def __init__(self, engine_for: EngineFor, *, own_process: bool) -> None:
        """Create the plugin; if `own_process`, the worker ignores Ctrl-C.

        In this case, the worker is a process of this program, which handles Ctrl-C itself.
        """
        self._engine_for, self._own_process = engine_for, own_process

    def setup(self, worker: object) -> None:  # noqa: ARG002 - the library's signature
        """Start the event loop of the engines."""
        if self._own_process:
            signal.signal(signal.SIGINT, signal.SIG_IGN)
        self._temporary = TemporaryDirectory(prefix="pa-console-")
        self._folder = Path(self._temporary.name)
        self._engines: dict[str, MemoEngine] = {}
        self._sites: dict[str, Site] = {}
        self._turn = Lock()
        self._loop = asyncio.new_event_loop()
        self._thread = Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()

    def teardown(self, worker: object) -> None:  # noqa: ARG002
        """Cancel the run in progress, and end the processes of the models."""
        asyncio.run_coroutine_threadsafe(self._close(), self._loop).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._temporary.cleanup()

    def make(self, task: RemoteRun) -> MadeRun:
        """Make and return the run of `task`; errors of the run are passed on."""
        with self._turn:
            return asyncio.run_coroutine_threadsafe(self._make(task), self._loop).result()

    async def _make(self, task: RemoteRun) -> MadeRun:
        site = self._site(task)
        job = Job(task.mission_set, task.case, site, task.model, task.variant, task.seed)
        if task.model not in self._engines:
            self._engines[task.model] = self._engine_for(task.model)
        log = None
        if task.keep_log:
            log = self._folder / LOGS / f"{task.stem}.jsonl"
            log.parent.mkdir(exist_ok=True)
            log.unlink(missing_ok=True)
        record = await make_run(job, self._engines[task.model], partial(idle_score, job), log)
        return MadeRun(record, log.read_bytes() if log is not None else None)

    def _site(self, task: RemoteRun) -> Site:
        """Return the site of a run, and write its files the first time.

        Raises DocumentError if a file is not valid.
        """
        name = hashlib.sha256(f"{task.world}\0{task.rules}".encode()).hexdigest()[:16]
        if name not in self._sites:
            folder = self._folder / name
            folder.mkdir()
            world, rules = folder / "world.yaml", folder / "rules.yaml"
            world.write_text(task.world, encoding="utf-8")
            rules.write_text(task.rules, encoding="utf-8")
            self._sites[name] = load_site(str(world), str(rules), unsigned=True)
        return self._sites[name]

    async def _close(self) -> None:
        runs = asyncio.all_tasks() - {asyncio.current_task()}
        for run in runs:
            run.cancel()
        await asyncio.gather(*runs, return_exceptions=True)
        for engine in self._engines.values():
            await engine.close()


def make_remotely(task: RemoteRun) -> MadeRun:
    """Make and return the run of `task` with the plugin of the current worker."""
    return cast(Any, get_worker()).plugins[PLUGIN].make(task)


@dataclass(frozen=True)
class ModelOnWorker:
    """A function that returns the engine of a model on the worker's machine.

    By the name of a model, `asked` has the model option, and `fingerprints` has the required
    fingerprint. `count` is the number of workers that share the machine. `reuse` and `exact` are
    the options of MemoEngine.
    """

    asked: dict[str, str | None]
    fingerprints: dict[str, str]
    second_reader: str
    count: int = 1
    reuse: bool = False
    exact: bool = True

    def __call__(self, name: str) -> MemoEngine:
        """Return the engine of the model `name`; raises ModelError if its fingerprint differs."""
        model = find_model(self.asked[name], second_reader=self.second_reader)
        if model.fingerprint != self.fingerprints[name]:
            raise ModelError(f"{name} on {socket.gethostname()} is not the model of this sweep")
        engine = Engine(model, threads=max(1, physical_cores() // max(1, self.count)))
        return MemoEngine(engine, exact=self.exact, reuse=self.reuse)


class Sweep:
    """The sweep over all jobs that have no run in `results`, on Dask's workers."""

    def __init__(
        self,
        results: EvaluationFolder,
        engine_for: EngineFor,
        fingerprints: dict[str, str],
        *,
        keep_logs: bool = True,
        report: Callable[[str], None] = lambda _text: None,
        again_s: float = AGAIN_S,
    ) -> None:
        """Prepare a sweep; `fingerprints` are by the name of the model.

        `report` is called with lines about the progress. If the scheduler is lost, the sweep tries
        to reach it every `again_s` seconds.
        """
        self._report, self._again_s = report, again_s
        self._results, self._engine_for = results, engine_for
        self._fingerprints, self._keep_logs = fingerprints, keep_logs
        self._reached = False
        """True after the scheduler was reached once; from then on, the sweep waits if it is lost.
        """

    async def run(self, workers: Workers, jobs: Sequence[Job]) -> AsyncGenerator[RunRecord]:
        """Yield each run once it is stored, in the order in which the runs end.

        Raises SweepError if no scheduler answers, or if a run crashes every worker that makes it.
        """
        async with cluster(workers) as target:
            async for record in self.run_on(target, jobs):
                yield record

    async def run_on(self, target: Any, jobs: Sequence[Job]) -> AsyncGenerator[RunRecord]:
        """Yield each run from the workers of `target`, which is an address or a Dask cluster.

        At the end, the file of runs is in the order in which a single process would make them.
        """
        clock = asyncio.get_running_loop().time
        ordered, last = in_order(self._missing(jobs)), clock()
        while missing := self._missing(ordered):
            try:
                async for record in self._round(target, missing):
                    last = clock()
                    yield record
            except (OSError, TimeoutError) as error:
                if not self._reached or clock() - last > AWAY_S:
                    raise SweepError(
                        f"no scheduler answers at {target}: check the address"
                    ) from error
            if left := self._missing(ordered):
                self._report(f"the scheduler is unreachable: {len(left)} runs are submitted again")
                await asyncio.sleep(self._again_s)
        self._results.arrange([job.run for job in ordered])

    async def _round(self, target: Any, jobs: Sequence[Job]) -> AsyncGenerator[RunRecord]:
        """Submit `jobs`, and yield the runs until all are complete or the scheduler is lost."""
        tasks = [
            RemoteRun.of(job, self._fingerprints[job.model], keep_log=self._keep_logs)
            for job in jobs
        ]
        stems = {job.run: job.stem for job in jobs}
        connecting: Any = Client(target, asynchronous=True, timeout=AGAIN_S)
        async with connecting as client:
            self._reached = True
            plugin = RunMaker(self._engine_for, own_process=not isinstance(target, str))
            await client.register_plugin(plugin, name=PLUGIN)
            futures = [client.submit(make_remotely, task, key=task.key) for task in tasks]
            completed: Any = as_completed(futures)
            async for future in completed:
                if future.status == "error":
                    raise _failed(await future.exception())
                if future.status != "finished":  # lost in a restart of the scheduler
                    continue
                made: MadeRun = await future.result()
                yield self._kept(made, stems[made.record.run])
                future.release()

    def _missing(self, jobs: Sequence[Job]) -> list[Job]:
        done = self._results.done
        return [job for job in jobs if job.run not in done]

    def _kept(self, made: MadeRun, stem: str) -> RunRecord:
        """Store and return a completed run; its log is written first, as the record names it."""
        if made.log is not None:
            (self._results.folder / LOGS / f"{stem}.jsonl").write_bytes(made.log)
        self._results.add(made.record)
        return made.record


def _failed(error: BaseException) -> BaseException:
    if isinstance(error, KilledWorker):
        return SweepError(f"a run crashed every worker that made it: {error}")
    return error


@asynccontextmanager
async def cluster(workers: Workers) -> AsyncGenerator[Any]:
    """Yield the target to which a client connects; on exit, local worker processes are ended."""
    if workers.scheduler:
        yield workers.scheduler
        return
    started = cast(Any, LocalCluster)(
        n_workers=workers.count,
        threads_per_worker=1,
        processes=True,
        asynchronous=True,
        host="127.0.0.1",
        dashboard_address=None,
        silence_logs=logging.CRITICAL,
    )
    with isolated_workers():
        async with started as running:
            yield running
