"""The runs of an evaluation on Dask's workers; the module is imported only for a sweep.

World, rules and mission of a run are sent as text, so that workers on any machine can make the run.
"""

import asyncio
import hashlib
import json
import socket
from collections.abc import AsyncGenerator, Callable, Sequence
from dataclasses import dataclass
from functools import partial
from threading import Thread
from typing import Any

from pa_console import __version__
from pa_console.evaluation.dask_sweep import (
    AGAIN_S,
    DaskSweep,
    SweepError,
    TaskMaker,
    Workers,
    cluster,
)
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

EngineFor = Callable[[str], MemoEngine]
"""A function that is sent to the workers and returns the engine of a model there."""


@dataclass(frozen=True)
class RemoteRun:
    """A job in the form for a worker; `world` and `rules` are the texts of the files."""

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
        """The key of the run on the scheduler, which is its id and a hash of all dependencies."""
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


class RunMaker(TaskMaker[RemoteRun, MadeRun]):
    """The plugin that makes runs on a worker, one at a time, in its own event loop.

    It keeps engines and sites from run to run.
    """

    name = "pa-console runs"

    def __init__(self, engine_for: EngineFor) -> None:
        self._engine_for = engine_for

    def begin(self) -> None:
        """Start the event loop of the engines."""
        self._engines: dict[str, MemoEngine] = {}
        self._sites: dict[str, Site] = {}
        self._loop = asyncio.new_event_loop()
        self._thread = Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self._one = asyncio.Lock()

    def end(self) -> None:
        """Cancel the runs in progress, and end the processes of the models."""
        asyncio.run_coroutine_threadsafe(self._close(), self._loop).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()

    def make(self, task: RemoteRun) -> MadeRun:
        """Return the run of `task`; errors of the run are passed on."""
        return asyncio.run_coroutine_threadsafe(self._make(task), self._loop).result()

    async def _make(self, task: RemoteRun) -> MadeRun:
        async with self._one:
            site = self._site(task)
            job = Job(task.mission_set, task.case, site, task.model, task.variant, task.seed)
            if task.model not in self._engines:
                self._engines[task.model] = self._engine_for(task.model)
            log = None
            if task.keep_log:
                log = self.folder / LOGS / f"{task.stem}.jsonl"
                log.parent.mkdir(exist_ok=True)
                log.unlink(missing_ok=True)
            record = await make_run(job, self._engines[task.model], partial(idle_score, job), log)
            return MadeRun(record, log.read_bytes() if log is not None else None)

    def _site(self, task: RemoteRun) -> Site:
        """Return the site of a run, and write its files once; raises DocumentError if not valid."""
        name = hashlib.sha256(f"{task.world}\0{task.rules}".encode()).hexdigest()[:16]
        if name not in self._sites:
            folder = self.folder / name
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


@dataclass(frozen=True)
class ModelOnWorker:
    """A function that returns the engine of a model on the worker's machine.

    By the name of the model, `asked` has the model option, and `fingerprints` the required
    fingerprint. `count` workers share the machine. `reuse` and `exact` are those of MemoEngine.
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
    """The sweep over all jobs that are missing from `results`, on Dask's workers."""

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
        """Use the models' `fingerprints` by name; `told` and `again_s` are as in DaskSweep."""
        self._told, self._again_s = told, again_s
        self._results, self._engine_for = results, engine_for
        self._fingerprints, self._keep_logs = fingerprints, keep_logs

    async def run(self, workers: Workers, jobs: Sequence[Job]) -> AsyncGenerator[RunRecord]:
        """Yield each run once it is stored, in the order in which the runs end.

        Raises SweepError if there is no scheduler, or if a run ends every worker that makes it.
        """
        async with cluster(workers) as target:
            async for record in self.run_on(target, jobs):
                yield record

    async def run_on(self, target: Any, jobs: Sequence[Job]) -> AsyncGenerator[RunRecord]:
        """Yield each run from the workers of `target`, an address or a cluster of Dask.

        At the end, the file has the runs in the order in which a single process would make them.
        """
        ordered = in_order(self._missing(jobs))
        stems = {job.run: job.stem for job in ordered}

        def missing() -> list[RemoteRun]:
            return [
                RemoteRun.of(job, self._fingerprints[job.model], keep_log=self._keep_logs)
                for job in self._missing(ordered)
            ]

        sweep = DaskSweep(
            RunMaker(self._engine_for), missing, told=self._told, again_s=self._again_s
        )
        async for made in sweep.run_on(target):
            yield self._kept(made, stems[made.record.run])
        self._results.arrange([job.run for job in ordered])

    def _missing(self, jobs: Sequence[Job]) -> list[Job]:
        done = self._results.done
        return [job for job in jobs if job.run not in done]

    def _kept(self, made: MadeRun, stem: str) -> RunRecord:
        """Store a completed run; the log is first, because the record refers to it."""
        if made.log is not None:
            (self._results.folder / LOGS / f"{stem}.jsonl").write_bytes(made.log)
        self._results.add(made.record)
        return made.record
