"""The verb `data`: fills a folder with samples that planner and judge learn from."""

from collections.abc import Sequence
from contextlib import closing
from itertools import islice
from pathlib import Path

from rich.table import Table

from pa_console.resources import find_data
from pa_console.schema.text import count
from pa_console.terminal.output import errors, out, print_json
from pa_training.orders.written import Source
from pa_training.samples.data_report import REPORT, DataReport, fingerprint, write_report
from pa_training.samples.data_set import DataFolder, build
from pa_training.samples.groups import Recipe, recipes
from pa_training.verbs.progress import DataProgress

MOST_REASONS = 12
"""Reasons for drops that are printed; the report has them all."""


def wanted_groups(rounds: int, plans: int, most: int | None, *, spoken: bool) -> list[Recipe]:
    """Return the groups to learn from, `most` at most, and those of the writers kept aside.

    Raises DocumentError for a broken file of a writer.
    """
    sources: tuple[Source, ...] = ("written", "spoken") if spoken else ("written",)
    learnt = (recipe for source in sources for recipe in recipes(source, rounds, plans))
    return [*islice(learnt, most), *islice(recipes("development"), most)]


def make_data(
    folder: Path, wanted: Sequence[Recipe], processes: int, rules: str, json: bool
) -> None:
    """Make the `wanted` groups that `folder` does not have yet, write and print its report.

    Raises DocumentError for a broken rule file, ValueError for a folder that holds something else.
    """
    rules_file = find_data("rules", rules, "rules.yaml")
    data, generator = DataFolder(folder), fingerprint(rules_file)
    missing = [recipe for recipe in wanted if recipe not in data]
    if there := len(wanted) - len(missing):
        errors.print(f"there already: {count(there, 'group')}")
    try:
        groups = build(missing, rules_file, generator, processes)
        with DataProgress(len(wanted), there) as progress, closing(groups):
            for made in groups:
                data.add(made)
                progress.add(len(made.samples))
    except KeyboardInterrupt:
        errors.print_line(
            f"stopped: what is whole is kept; the same command with --out {folder} goes on"
        )
        raise
    report = write_report(folder)
    if len(report.generators) > 1:
        errors.print(
            "note: rules, words or code changed since; the report tells the versions apart",
            style="yellow",
        )
    if json:
        print_json(report)
    else:
        _print(folder, report)


def _print(folder: Path, report: DataReport) -> None:
    table = Table("samples", "train", "valid")
    train, valid = report.samples["train"], report.samples["valid"]
    for task in dict.fromkeys([*train, *valid]):
        table.add_row(task, str(train.get(task, 0)), str(valid.get(task, 0)))
    out.print(table)
    dropped = Table("dropped", "orders or plans")
    for why, number in list(report.dropped.items())[:MOST_REASONS]:
        dropped.add_row(why, str(number))
    out.print(dropped)
    out.print_line(str(folder / REPORT))
