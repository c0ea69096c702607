"""Makes the runs of an evaluation, several side by side if asked, and keeps each as it ends."""

import asyncio
from collections.abc import AsyncGenerator, Callable, Sequence
from functools import partial
from itertools import groupby

from pa_console.evaluation.runs.jobs import Job
from pa_console.evaluation.runs.memo_engine import MemoEngine
from pa_console.evaluation.runs.one_run import enforced_rules, make_run
from pa_console.evaluation.runs.run_record import LOGS, EvaluationFolder, RunRecord
from pa_console.evaluation.scoring.idle_run import idle_run
from pa_console.evaluation.scoring.score import Score

EngineFor = Callable[[str, int], MemoEngine]
"""Gives the engine of a model for lane 0, 1, ...; every lane has one of its own."""

CHUNK = 12
"""Missions that a lane takes through all variants before the next ones: a prompt's fixed part is
read seldom, and a variant's equal prompts are answered soon after each other."""


class Runner:
    """Makes every job that `results` does not hold yet."""

    def __init__(
        self,
        results: EvaluationFolder,
        engine_for: EngineFor,
        *,
        lanes: int = 1,
        keep_logs: bool = True,
    ) -> None:
        self._results, self._engine_for = results, engine_for
        self._lanes, self._keep_logs = lanes, keep_logs
        self._idle: dict[tuple[str, str, int], Score] = {}

    async def run(self, jobs: Sequence[Job]) -> AsyncGenerator[RunRecord]:
        """Yield each run when it was made and written; models are taken one after the other.

        Raises what a run ran into; the other lanes are stopped then.
        """
        done = self._results.done
        missing = [job for job in jobs if job.run not in done]
        for model, of_model in groupby(missing, key=lambda job: job.model):
            async for record in self._model(model, list(of_model)):
                yield record

    async def _model(self, model: str, jobs: list[Job]) -> AsyncGenerator[RunRecord]:
        """Yield the runs of one model, its weights loaded once a lane."""
        waiting = chunks(jobs)
        made: asyncio.Queue[RunRecord | BaseException | None] = asyncio.Queue()
        count = min(self._lanes, len(waiting))
        lanes = [
            asyncio.create_task(self._lane(self._engine_for(model, n), waiting, made))
            for n in range(count)
        ]
        try:
            while count:
                item = await made.get()
                if item is None:
                    count -= 1
                elif isinstance(item, BaseException):
                    raise item
                else:
                    self._results.add(item)
                    yield item
        finally:
            for lane in lanes:
                lane.cancel()
            await asyncio.gather(*lanes, return_exceptions=True)

    async def _lane(
        self,
        engine: MemoEngine,
        waiting: list[list[Job]],
        made: asyncio.Queue[RunRecord | BaseException | None],
    ) -> None:
        try:
            while waiting:
                for job in waiting.pop(0):
                    made.put_nowait(await self._make(job, engine))
        except Exception as error:
            made.put_nowait(error)
        finally:
            await engine.close()
        made.put_nowait(None)

    async def _make(self, job: Job, engine: MemoEngine) -> RunRecord:
        log = self._results.folder / LOGS / f"{job.stem}.jsonl" if self._keep_logs else None
        if log is not None:
            log.unlink(missing_ok=True)
        return await make_run(job, engine, partial(self._idle_score, job), log)

    def _idle_score(self, job: Job) -> Score:
        """Return what becomes of the job's mission when nothing is ordered; known after once."""
        key = (job.mission_set, job.case.id, job.seed)
        if key not in self._idle:
            enforced = enforced_rules(job.site.rulebook)
            self._idle[key] = idle_run(job.case, job.site.world, job.seed, enforced)
        return self._idle[key]


def chunks(jobs: Sequence[Job]) -> list[list[Job]]:
    """Return the jobs in the order in which they are made: CHUNK missions, variant by variant."""
    cases = list(dict.fromkeys((job.mission_set, job.case.id, job.seed) for job in jobs))
    place = {case: number // CHUNK for number, case in enumerate(cases)}
    found: list[list[Job]] = [[] for _ in range(-(-len(cases) // CHUNK))]
    for job in jobs:
        found[place[job.mission_set, job.case.id, job.seed]].append(job)
    return found


def in_order(jobs: Sequence[Job]) -> list[Job]:
    """Return the jobs in the order in which one lane makes them, one model after the other."""
    by_model = groupby(jobs, key=lambda job: job.model)
    return [job for _, group in by_model for chunk in chunks(list(group)) for job in chunk]
