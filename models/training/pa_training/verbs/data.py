"""The verbs `data`, `orders`, `readings` and `written`: they fill files and folders."""

import gzip
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Literal

from rich.table import Table

from pa_console.cli.options import dask_workers
from pa_console.resources import find_data
from pa_console.schema.text import count
from pa_console.terminal.output import errors, out, print_json
from pa_training import LANGUAGE
from pa_training.samples.data_report import DataReport, fingerprint, write_report
from pa_training.samples.data_set import REPORT, DataFolder, Job, Made, Part, build
from pa_training.samples.planner_samples import Recipe
from pa_training.samples.reading_samples import write_readings
from pa_training.samples.taught_orders import write_taught_orders
from pa_training.samples.written_orders import read_writers, written_samples
from pa_training.verbs.progress import DataProgress, ReadingProgress

MOST_REASONS = 12
"""Reasons for drops that are printed; the report has them all."""


def make_data(
    folder: Path,
    recipes: Sequence[Recipe],
    processes: int,
    where: int | str,
    parts: tuple[Part, ...],
    rules: str,
    json: bool,
) -> None:
    """Make the groups of `recipes` that `folder` does not have yet, write and print its report.

    They are made by so many `processes`, or with Dask: `where` is how many workers, or a scheduler.
    Raises DocumentError for a broken rule file, ValueError for a folder that holds something else,
    and without Dask or a scheduler.
    """
    rules_file = find_data("rules", rules, "rules.yaml")
    generator = fingerprint(rules_file)
    data = DataFolder(folder, generator)
    jobs, groups = _missing(data, recipes, parts), len(recipes)
    _tell_before(data, generator, groups - len(jobs))
    try:
        with DataProgress(groups, groups - len(jobs)) as progress:

            def keep(job: Job, made: Made) -> None:
                data.add(job.recipe, job.parts, made)

            def keep_and_tell(job: Job, made: Made) -> None:
                keep(job, made)
                progress.add(made)

            if where:
                workers = dask_workers(where)
                from pa_training.samples.data_sweep import build_on_dask  # noqa: PLC0415

                build_on_dask(
                    jobs, rules_file, workers, keep, on_made=progress.add, told=errors.print
                )
            else:
                build(jobs, rules_file, processes, keep_and_tell)
    except KeyboardInterrupt:
        errors.print_line(
            f"stopped: what is whole is kept; the same command with --out {folder} goes on"
        )
        raise
    finally:
        data.mend()
        report = write_report(folder) if data.entries else None
    if json:
        print_json(report)
        return
    if report is not None:
        _print(folder, report)


def _missing(data: DataFolder, recipes: Sequence[Recipe], parts: tuple[Part, ...]) -> list[Job]:
    """Return what is still to be made, in order."""
    jobs = (Job(recipe, data.missing(recipe, parts)) for recipe in recipes)
    return [job for job in jobs if job.parts]


def _tell_before(data: DataFolder, generator: str, there: int) -> None:
    """Say what is there already, and that another version of the generator has made it."""
    if there:
        errors.print(f"there already: {count(there, 'group')}")
    if data.generators - {generator}:
        errors.print(
            "note: rules, words or code changed since; the report tells the versions apart",
            style="yellow",
        )


def _print(folder: Path, report: DataReport) -> None:
    table = Table("samples", "train", "valid")
    train, valid = report.samples["train"], report.samples["valid"]
    for task in dict.fromkeys([*train, *valid]):
        table.add_row(task, str(train.get(task, 0)), str(valid.get(task, 0)))
    out.print(table)
    dropped = Table("dropped", "missions or texts")
    for why, number in list(report.dropped.items())[:MOST_REASONS]:
        dropped.add_row(why, str(number))
    out.print(dropped)
    out.print_line(str(folder / REPORT))


def make_taught_orders(file: Path, groups: int) -> None:
    """Write the orders of so many situations."""
    file.parent.mkdir(parents=True, exist_ok=True)
    made = 0
    with ReadingProgress(groups) as progress:
        for orders in write_taught_orders(file, groups):
            made += orders
            progress.add(orders)
    out.print_line(str(file))
    errors.print(count(made, "order"))


def make_readings(file: Path, recipes: Sequence[Recipe], rules: str, processes: int) -> None:
    """Write the samples of `recipes` to `file` and print how many there are.

    Raises DocumentError for a broken rule file, ValueError for a file that is there already.
    """
    if file.exists():
        raise ValueError(f"{file}: is there already; name another file, or remove it")
    file.parent.mkdir(parents=True, exist_ok=True)
    made = 0
    written = write_readings(file, recipes, find_data("rules", rules, "rules.yaml"), processes)
    with ReadingProgress(len(recipes)) as progress, closing(written) as groups:
        for samples in groups:
            made += samples
            progress.add(samples)
    out.print_line(str(file))
    errors.print(count(made, "sample"))


def make_written(file: Path, folder: Literal["written", "development"]) -> None:
    """Write the samples of the writers in `folder` to `file`, and print how many there are.

    Raises DocumentError for a broken file of a writer, ValueError for a `file` that is there.
    """
    if file.exists():
        raise ValueError(f"{file}: is there already; name another file, or remove it")
    file.parent.mkdir(parents=True, exist_ok=True)
    made, writers = 0, read_writers(LANGUAGE / folder)
    with gzip.open(file, "wt", encoding="utf-8") as stream:
        for name, writer in writers.items():
            for sample in written_samples(name, writer):
                stream.write(f"{sample.model_dump_json()}\n")
                made += 1
    out.print_line(str(file))
    errors.print(f"{count(len(writers), 'writer')}, {count(made, 'sample')}")
