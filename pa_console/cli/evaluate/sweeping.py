"""A sweep of `pa-console eval`: the runs on Dask's workers; imported where one is asked for."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import aclosing
from dataclasses import dataclass

from pa_console.cli.dask_options import dask_workers
from pa_console.cli.output import errors
from pa_console.evaluation.runs.jobs import Job
from pa_console.evaluation.runs.run_record import EvaluationFolder, RunRecord
from pa_console.llm.models.catalogue import LocalModel


@dataclass(frozen=True)
class SweptModels:
    """The models by name, the requested files of each, and their backends."""

    local: Mapping[str, LocalModel]
    asked: dict[str, str | None]
    second_reader: str
    reuse: bool


async def sweep(
    results: EvaluationFolder,
    planned: Sequence[Job],
    where: int | str,
    models: SweptModels,
    add: Callable[[RunRecord], object],
    *,
    keep_logs: bool,
) -> None:
    """Make the `planned` runs `where`: in so many processes here, or at that scheduler.

    `add` is told of each run as it comes back. Raises ValueError without Dask, or a scheduler.
    """
    workers = dask_workers(where)
    from pa_console.evaluation.runs.sweep import ModelOnWorker, Sweep  # noqa: PLC0415

    prints = {name: model.fingerprint for name, model in models.local.items()}
    engine_for = ModelOnWorker(
        models.asked, prints, models.second_reader, workers.count, models.reuse
    )
    made = Sweep(results, engine_for, prints, keep_logs=keep_logs, told=errors.print)
    async with aclosing(made.run(workers, planned)) as records:
        async for record in records:
            add(record)
