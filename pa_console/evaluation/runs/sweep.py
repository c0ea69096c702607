"""Makes the runs of an evaluation on the workers of a Dask scheduler; imported for that alone.

A run is sent as text, so that a worker on any machine can make it: its world, its rules, its
mission. It goes under a key of its own: it is made once however often it is sent. Results come as
they finish. What a killed worker had under way is made by another one, and what a scheduler that
was restarted has forgotten is sent again.
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
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread
from typing import Any, cast

from distributed import Client, LocalCluster, WorkerPlugin, as_completed, get_worker
from distributed.scheduler import KilledWorker

from pa_console import __version__
from pa_console.evaluation.runs.jobs import Job
from pa_console.evaluation.runs.memo_engine import MemoEngine
from pa_console.evaluation.runs.one_run import enforced_rules, make_run
from pa_console.evaluation.runs.run_record import LOGS, EvaluationFolder, RunRecord
from pa_console.evaluation.runs.runner import in_order
from pa_console.evaluation.scoring.idle_run import idle_run
from pa_console.llm.engine.engine import Engine
from pa_console.llm.errors import ModelError
from pa_console.llm.models.catalogue import find_model
from pa_console.llm.worker.threads import physical_cores
from pa_console.orchestrator.station.assembly import Site, load_site
from pa_console.schema.document import read_text
from pa_console.schema.evaluation import MissionCase, Variant

AWAY_S = 600.0
"""So long a scheduler that is away is waited for."""
AGAIN_S = 2.0
"""Between two tries to reach it."""
PLUGIN = "pa-console runs"

EngineFor = Callable[[str], MemoEngine]
"""Gives the engine of a model on the worker that calls it; it is sent there."""


class SweepError(ValueError):
    """A sweep that cannot go on; what was made is kept, and the same command goes on with it."""


@dataclass(frozen=True)
class RemoteRun:
    """A job as it is sent: `world` and `rules` are the texts of the files."""

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
        """Return `job` as text; raises SweepError where its rules are in no file."""
        if job.site.rules_path is None:
            raise SweepError("a sweep needs rules that are in a file")
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
        """What the run goes by on the scheduler: its id, and a hash of everything it depends on."""
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
    """The record of a run, and its event log."""

    record: RunRecord
    log: bytes | None


class RunMaker(WorkerPlugin):
    """Makes runs on a worker, one at a time; its engines and sites are kept from run to run."""

    name = PLUGIN

    def __init__(self, engine_for: EngineFor, *, own_process: bool = False) -> None:
        """A worker in a process of this program's own leaves Ctrl-C to the program."""
        self._engine_for, self._own_process = engine_for, own_process

    def setup(self, worker: object) -> None:  # noqa: ARG002 - the library's signature
        """Start the loop that the engines live in, beside the worker's own."""
        if self._own_process:
            signal.signal(signal.SIGINT, signal.SIG_IGN)
        self._loop = asyncio.new_event_loop()
        self._thread = Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self._folder = TemporaryDirectory(prefix="pa-console-")
        self._engines: dict[str, MemoEngine] = {}
        self._sites: dict[str, Site] = {}
        self._turn = asyncio.Lock()

    def teardown(self, worker: object) -> None:  # noqa: ARG002
        """End the models' processes."""
        asyncio.run_coroutine_threadsafe(self._close(), self._loop).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._folder.cleanup()

    def make(self, run: RemoteRun) -> MadeRun:
        """Make `run` and wait for it; raises what it ran into."""
        return asyncio.run_coroutine_threadsafe(self._make(run), self._loop).result()

    async def _make(self, run: RemoteRun) -> MadeRun:
        async with self._turn:
            job = Job(run.mission_set, run.case, self._site(run), run.model, run.variant, run.seed)
            if run.model not in self._engines:
                self._engines[run.model] = self._engine_for(run.model)
            log = None
            if run.keep_log:
                log = Path(self._folder.name) / LOGS / f"{run.stem}.jsonl"
                log.parent.mkdir(exist_ok=True)
                log.unlink(missing_ok=True)
            enforced = enforced_rules(job.site.rulebook)
            record = await make_run(
                job,
                self._engines[run.model],
                lambda: idle_run(job.case, job.site.world, job.seed, enforced),
                log,
            )
            return MadeRun(record, log.read_bytes() if log is not None else None)

    def _site(self, run: RemoteRun) -> Site:
        """Return the site of `run`, whose files are written once."""
        name = hashlib.sha256(f"{run.world}\0{run.rules}".encode()).hexdigest()[:16]
        if name not in self._sites:
            folder = Path(self._folder.name) / name
            folder.mkdir()
            world, rules = folder / "world.yaml", folder / "rules.yaml"
            world.write_text(run.world, encoding="utf-8")
            rules.write_text(run.rules, encoding="utf-8")
            self._sites[name] = load_site(str(world), str(rules), unsigned=True)
        return self._sites[name]

    async def _close(self) -> None:
        """Break off what is being made, whose thread would wait for it, and end the models."""
        making = asyncio.all_tasks() - {asyncio.current_task()}
        for task in making:
            task.cancel()
        await asyncio.gather(*making, return_exceptions=True)
        for engine in self._engines.values():
            await engine.close()


@dataclass(frozen=True)
class ModelOnWorker:
    """Gives the engine of a model that is on the worker's machine.

    `asked` is what was asked for by the model's name, and `fingerprints` what it has to be. A
    `count` of workers share the machine; answers are reused on each with `reuse`.
    """

    asked: dict[str, str | None]
    fingerprints: dict[str, str]
    second_reader: str
    count: int = 1
    reuse: bool = False

    def __call__(self, name: str) -> MemoEngine:
        """Return the engine of the model `name`; raises ModelError where it is not the same."""
        model = find_model(self.asked[name], second_reader=self.second_reader)
        if model.fingerprint != self.fingerprints[name]:
            raise ModelError(f"{name} on {socket.gethostname()} is not the model of this sweep")
        engine = Engine(model, threads=max(1, physical_cores() // max(1, self.count)))
        return MemoEngine(engine, exact=True, reuse=self.reuse)


def make_remotely(run: RemoteRun) -> MadeRun:
    """Make `run` on the worker that this is called on."""
    return cast(RunMaker, cast(Any, get_worker()).plugins[PLUGIN]).make(run)


@dataclass(frozen=True)
class Workers:
    """Where runs are made: at the `scheduler` at that address, or by `count` processes here."""

    scheduler: str = ""
    count: int = 0


class Sweep:
    """Makes every job that `results` does not hold yet on Dask's workers."""

    def __init__(
        self,
        results: EvaluationFolder,
        engine_for: EngineFor,
        fingerprints: dict[str, str],
        *,
        keep_logs: bool = True,
        told: Callable[[str], None] = lambda _text: None,
        again_s: float = AGAIN_S,
    ) -> None:
        """`fingerprints` are those of the models by name; `told` gets what a person should know.

        A scheduler that is away is looked for again after `again_s` seconds.
        """
        self._again_s = again_s
        self._reached = False
        """Whether there was a scheduler: one that goes away is waited for."""
        self._results, self._engine_for, self._told = results, engine_for, told
        self._fingerprints, self._keep_logs = fingerprints, keep_logs

    async def run(self, workers: Workers, jobs: Sequence[Job]) -> AsyncGenerator[RunRecord]:
        """Yield each run when it was made and written, in the order in which they finish.

        Raises SweepError when there is no scheduler, or a run ends every worker that makes it.
        """
        async with cluster(workers) as target:
            async for record in self.run_on(target, jobs):
                yield record

    async def run_on(self, target: Any, jobs: Sequence[Job]) -> AsyncGenerator[RunRecord]:
        """Yield the same with the workers of `target`, an address or a cluster of Dask.

        In the end the file has the runs in the order in which one process makes them.
        """
        clock = asyncio.get_running_loop().time
        last, ordered = clock(), in_order(self._missing(jobs))
        while missing := self._missing(ordered):
            try:
                async for record in self._round(target, missing):
                    last = clock()
                    yield record
            except (OSError, TimeoutError) as error:
                if not self._reached or clock() - last > AWAY_S:
                    raise SweepError(
                        f"no scheduler answers at {target}: see its address"
                    ) from error
            if left := self._missing(ordered):
                self._told(f"the scheduler is away: {len(left)} runs are sent again")
                await asyncio.sleep(self._again_s)
        self._results.arrange([job.run for job in ordered])

    def _missing(self, jobs: Sequence[Job]) -> list[Job]:
        done = self._results.done
        return [job for job in jobs if job.run not in done]

    async def _round(self, target: Any, jobs: Sequence[Job]) -> AsyncGenerator[RunRecord]:
        """Send `jobs` and yield what comes back, until all are there or the scheduler is gone."""
        connecting: Any = Client(target, asynchronous=True, timeout=AGAIN_S)
        async with connecting as client:
            self._reached = True
            maker = RunMaker(self._engine_for, own_process=not isinstance(target, str))
            await client.register_plugin(maker, name=PLUGIN)
            sent = [
                RemoteRun.of(job, self._fingerprints[job.model], keep_log=self._keep_logs)
                for job in jobs
            ]
            futures = [client.submit(make_remotely, run, key=run.key) for run in sent]
            stems = {run.run: run.stem for run in sent}
            completed: Any = as_completed(futures)
            async for future in completed:
                if future.status == "error":
                    raise self._failed(await future.exception())
                if future.status != "finished":  # the scheduler forgot it
                    continue
                made = cast(MadeRun, await future.result())
                yield self._kept(made, stems[made.record.run])
                future.release()

    def _kept(self, made: MadeRun, stem: str) -> RunRecord:
        """Write a run that came back: its log first, as its record says where that is."""
        if made.log is not None:
            (self._results.folder / LOGS / f"{stem}.jsonl").write_bytes(made.log)
        self._results.add(made.record)
        return made.record

    def _failed(self, error: BaseException) -> BaseException:
        if isinstance(error, KilledWorker):
            return SweepError(f"a run ended every worker that made it: {error}")
        return error


@asynccontextmanager
async def cluster(workers: Workers) -> AsyncGenerator[Any]:
    """Give what a client connects to; processes of this machine end when this is left."""
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
    async with started as running:
        yield running
