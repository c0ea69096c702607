"""Makes the runs of the degradation benchmark on Dask's workers; imported where that is asked for.

The rows are those of one process: which run was made where is not in them.
"""

import hashlib
import json
from collections.abc import AsyncGenerator, Callable, Sequence
from dataclasses import dataclass

from pa_console import __version__
from pa_console.evaluation.dask_sweep import (
    DaskSweep,
    LoopMaker,
    SentSites,
    SweepError,
    Workers,
    cluster,
)
from pa_console.evaluation.memo_engine import MemoEngine
from pa_console.evaluation.sweep import EngineFor
from pa_console.llm.models.catalogue import LocalModel
from pa_console.schema.document import read_text
from pa_console.station.assembly import Site
from tests.benchmarks.degradation.runs import Disturbance, RunFile, run_once
from tests.benchmarks.degradation.true_outcome import RunResult


@dataclass(frozen=True)
class RemoteRun:
    """One run of a `condition`; `made_of` is a hash of world, rules and model."""

    condition: Disturbance
    seed: int
    made_of: str

    @property
    def key(self) -> str:
        """What it goes by on the scheduler."""
        parts = json.dumps([self.condition.model_dump_json(), self.made_of])
        mark = hashlib.sha256(parts.encode()).hexdigest()[:16]
        return f"degradation-{self.seed}-{mark}"


@dataclass(frozen=True)
class MadeRun:
    """What came of a run; `asked` and `reused` are what the worker's engine counts since."""

    condition: str
    seed: int
    result: RunResult
    asked: int
    reused: int


class DegradationMaker(LoopMaker[RemoteRun, MadeRun]):
    """Makes runs on a worker, at the site of two texts, with one engine."""

    name = "pa-console degradation"

    def __init__(self, world: str, rules: str, model: str, engine_for: EngineFor) -> None:
        self._world, self._rules, self._model = world, rules, model
        self._engine_for = engine_for

    def begin(self) -> None:
        """Start the loop that the engine lives in."""
        super().begin()
        self._engine: MemoEngine | None = None
        self._sites = SentSites(self.folder)

    async def made(self, task: RemoteRun) -> MadeRun:
        """Return what comes of the run that `task` asks for."""
        if self._engine is None:
            self._engine = self._engine_for(self._model)
        engine, site = self._engine, self._sites.site(self._world, self._rules)
        asked, reused = engine.asked, engine.reused
        result = await run_once(site, engine, task.condition, task.seed)
        return MadeRun(
            task.condition.name, task.seed, result, engine.asked - asked, engine.reused - reused
        )

    async def close(self) -> None:
        """End the model's process."""
        if self._engine is not None:
            await self._engine.close()


class DegradationSweep:
    """Makes on Dask's workers every run that `kept` does not hold yet."""

    def __init__(
        self,
        site: Site,
        model: LocalModel,
        engine_for: EngineFor,
        kept: RunFile,
        told: Callable[[str], None] = lambda _text: None,
    ) -> None:
        """`engine_for` gives the engine of `model` on a worker; `told` is as in DaskSweep.

        Raises SweepError where the rules of `site` are in no file.
        """
        if site.rules_path is None:
            raise SweepError("a sweep needs rules that are in a file")
        world, rules = read_text(site.world_path), read_text(site.rules_path)
        parts = json.dumps([__version__, world, rules, model.fingerprint])
        self._made_of = hashlib.sha256(parts.encode()).hexdigest()
        self._maker = DegradationMaker(world, rules, model.name, engine_for)
        self._kept, self._told = kept, told

    async def run(
        self, workers: Workers, wanted: Sequence[tuple[Disturbance, int]]
    ) -> AsyncGenerator[MadeRun]:
        """Yield each of the `wanted` runs that was missing, when it was made and is kept.

        Raises SweepError when there is no scheduler, or a run ends every worker that makes it.
        """
        async with cluster(workers) as target:
            async for made in self.run_on(target, wanted):
                yield made

    async def run_on(
        self, target: object, wanted: Sequence[tuple[Disturbance, int]]
    ) -> AsyncGenerator[MadeRun]:
        """Yield the same with the workers of `target`, an address or a cluster of Dask."""

        def missing() -> list[RemoteRun]:
            return [
                RemoteRun(condition, seed, self._made_of)
                for condition, seed in wanted
                if seed not in self._kept.results(condition.name)
            ]

        sweep = DaskSweep(self._maker, missing, told=self._told)
        async for made in sweep.run_on(target):
            self._kept.add(made.condition, made.seed, made.result)
            yield made
