"""`pa-console eval`: mission sets against models and variants, with a report of the results."""

import asyncio
from collections.abc import AsyncGenerator, Sequence
from contextlib import aclosing
from datetime import datetime
from pathlib import Path
from time import perf_counter
from typing import Annotated, Self

import typer
from rich import box
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table as RichTable
from rich.text import Text

from pa_console import __version__
from pa_console.cli import completion
from pa_console.cli.options import (
    JsonOption,
    RulesOption,
    SchedulerOption,
    UnsignedOption,
    WorkersOption,
    WorldOption,
    one_of,
)
from pa_console.cli.progress_bars import LiveBar
from pa_console.cli.settings_defaults import settings_of
from pa_console.evaluation.jobs import (
    ABOUT,
    Job,
    LoadedSet,
    chosen_missions,
    find_variant,
    keep_worlds,
    load_set,
    mission_file,
    plan_jobs,
)
from pa_console.evaluation.memo_engine import MemoEngine
from pa_console.evaluation.reporting.statistics import ReportTable
from pa_console.evaluation.run_record import (
    EvaluationFolder,
    RunRecord,
    describe_machine,
    evaluations_folder,
    newest_evaluation,
    read_about,
    read_runs,
)
from pa_console.evaluation.runner import Runner
from pa_console.llm.local.engine import Engine
from pa_console.llm.local.threads import physical_cores
from pa_console.llm.models.catalogue import LocalModel, find_model
from pa_console.policy.pinned_rules import RulesPins
from pa_console.resources import missing_library, naming_what_is_missing
from pa_console.schema.text import count
from pa_console.station.assembly import load_site
from pa_console.terminal.output import errors, out, print_json, warn_of_altered

COLUMN_GAP = 2
"""The number of characters between two columns of a table."""
TITLE_WORD = 9
"""The length from which a word in a column's title may be broken, because model names are long."""

app = typer.Typer(
    help="Evaluate models and variants of the pipeline on mission sets.",
    epilog="\b\nVariants:\n" + "\n".join(f"  {name}\n    {about}" for name, about in ABOUT.items()),
)
FolderArgument = Annotated[
    Path | None, typer.Argument(help="Folder of an evaluation. Default: the newest one.")
]


class EvalProgress(LiveBar):
    """The progress of an evaluation: the completed runs, and the strict successes among them."""

    def __init__(self, total: int, done: int) -> None:
        """Start with `done` of `total` runs completed earlier."""
        self._total, self._made, self._strict = total, done, 0
        self._before = done
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=24),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=errors,
            transient=True,
        )
        self._task = self._progress.add_task("starting", total=total, completed=done)

    def __enter__(self) -> Self:
        super().__enter__()
        if self._before:
            errors.print(f"already done: {self._before} of {count(self._total, 'run')}")
        return self

    def add(self, record: RunRecord) -> None:
        """Add a completed run."""
        self._made += 1
        self._strict += record.strict
        share = f"strict {self._strict}/{self._made - self._before}"
        self._progress.update(self._task, advance=1, description=f"{share}  {record.run}")
        if not errors.is_terminal:
            word = "ok" if record.strict else "failed"
            line = f"{self._made}/{self._total} {record.run}: {record.status}, strict {word}"
            errors.print_line(line)


def to_rich(table: ReportTable, width: int = 100) -> RichTable:
    """Return `table`, without its note, for a terminal of `width` columns; long cells wrap.

    Each column has its own width, so that ids and intervals are not broken if there is room.
    """
    shown = RichTable(
        title=Text(table.title, style="bold"),
        title_justify="left",
        box=box.SIMPLE_HEAD,
        show_edge=False,
        pad_edge=False,
        padding=(0, 1, 0, 0),
    )
    for index, wide in enumerate(_widths(table, width)):
        justify = "right" if table.numeric(index) else "left"
        title = Text(table.columns[index])
        shown.add_column(title, justify=justify, overflow="fold", width=wide)
    for row in table.rows:
        shown.add_row(*map(Text, row))
    return shown


def _widths(table: ReportTable, width: int) -> list[int]:
    """Return a width for each column: its longest word, plus a share of the remaining room.

    The remaining room goes to the columns with the longest cells in proportion to their width.
    """
    room = max(width - COLUMN_GAP * len(table.columns), len(table.columns))
    cells = [list(column) for column in zip(table.columns, *table.rows, strict=True)]
    whole = [max(len(cell) for cell in column) or 1 for column in cells]
    widths = [
        max(
            max((len(word) for cell in column[1:] for word in cell.split()), default=1),
            *(min(len(word), TITLE_WORD) for word in column[0].split()),
        )
        for column in cells
    ]
    while sum(widths) > room:
        widths[widths.index(max(widths))] -= 1
    while sum(widths) < min(room, sum(whole)):
        need = [full / here for full, here in zip(whole, widths, strict=True)]
        widths[need.index(max(need))] += 1
    return widths


@app.callback(invoke_without_command=True)
def evaluate(
    context: typer.Context,
    missions: Annotated[
        list[str] | None,
        typer.Option(
            help="Mission set: a file, or the name of a set of the world. Repeatable.",
            autocompletion=completion.mission_sets,
        ),
    ] = None,
    model: Annotated[
        list[str] | None,
        typer.Option(
            "--model",
            help="Model: a name from the catalogue or a GGUF file. Repeatable.",
            autocompletion=completion.models,
        ),
    ] = None,
    variant: Annotated[
        list[str] | None, typer.Option(help="Variant of the pipeline. Repeatable.")
    ] = None,
    world: WorldOption = "checkpoint",
    rules: RulesOption = "checkpoint",
    repeat: Annotated[
        int, typer.Option(min=1, help="Repetitions of each run, with the seeds 0, 1, ...")
    ] = 1,
    only: Annotated[
        str, typer.Option(help="Run only missions whose id or category contains this text.")
    ] = "",
    every: Annotated[
        int, typer.Option(min=1, help="Run only every n-th mission of each category.")
    ] = 1,
    output: Annotated[
        Path | None,
        typer.Option("--out", help="Folder for the results; an interrupted evaluation continues."),
    ] = None,
    jobs: Annotated[
        int,
        typer.Option(min=1, help="Number of parallel runs, which affects the measured times."),
    ] = 1,
    reuse: Annotated[
        bool,
        typer.Option(
            "--reuse/--no-reuse",
            help="Reuse the answer, and its measured time, if the same prompt comes again "
            "(decoding is greedy).",
        ),
    ] = False,
    workers: WorkersOption = 0,
    scheduler: SchedulerOption = "",
    logs: Annotated[bool, typer.Option(help="Keep the event log of every run.")] = True,
    unsigned: UnsignedOption = False,
    json: JsonOption = False,
) -> None:
    """Run missions, score them on the true state, and write the runs and the reports."""
    if context.invoked_subcommand is not None:
        return
    site = load_site(world, rules, unsigned=unsigned)
    warn_of_altered(rules, site.rulebook.seal)
    if why := RulesPins().refusal(site.rulebook.name, site.rulebook.seal):
        errors.print_line(
            f"warning: a session would refuse the rules of this evaluation: {why}",
            style="bold red",
        )
    one_of(jobs=jobs > 1, workers=bool(workers), scheduler=bool(scheduler))
    variants = [find_variant(name) for name in variant or ("full",)]
    reader = settings_of(context).values.second_reader
    requested = model or [None]
    local_models = [find_model(name, second_reader=reader) for name in requested]
    models = {local.name: local for local in local_models}
    folder = output or evaluations_folder() / f"{datetime.now():%Y%m%d-%H%M%S}"
    files = [mission_file(name, site.world_path) for name in missions or ("paper",)]
    wanted = [
        LoadedSet(part, loaded.sites)
        for loaded in (
            load_set(file, world, site.rulebook, folder / "worlds", site.rules_path)
            for file in files
        )
        if (part := chosen_missions(loaded.missions, only, every)) is not None
    ]
    if not wanted:
        raise ValueError(f"--only {only!r} matches no mission of {', '.join(map(str, files))}")
    planned = plan_jobs(wanted, list(models), variants, range(repeat))
    results = EvaluationFolder(folder)  # only now: wrong input leaves no folder behind
    for loaded in wanted:
        keep_worlds(loaded)
    began = perf_counter()
    try:
        if workers or scheduler:
            names = {local.name: name for local, name in zip(local_models, requested, strict=True)}
            where = workers or scheduler
            made = _swept(results, planned, where, models, names, reader, reuse=reuse, logs=logs)
        else:
            made = _made_here(results, planned, models, jobs, reuse=reuse, logs=logs)
        asyncio.run(_count(made, results, planned))
    except KeyboardInterrupt:
        made = len(results.done & {job.run for job in planned})
        errors.print_line(
            f"stopped after {made} of {count(len(planned), 'run')}; to continue, run the same "
            f"command with --out {folder}"
        )
        raise
    finally:
        lanes = max(jobs, workers)
        results.describe(_about(results, sets_of(planned), perf_counter() - began, lanes, reuse))
    _report(folder, json=json)


@app.command()
def report(folder: FolderArgument = None, json: JsonOption = False) -> None:
    """Write the report of an evaluation again, and print its tables."""
    _report(_chosen(folder), json=json)


@app.command()
def show(context: typer.Context, folder: FolderArgument = None) -> None:
    """Show an evaluation in the console: its runs, their failures and their traces."""
    chosen = _chosen(folder)
    read_runs(chosen)
    from pa_console.tui.app import show_evaluation  # noqa: PLC0415 - Textual is slow

    show_evaluation(chosen, settings_of(context))


def _chosen(folder: Path | None) -> Path:
    """Return `folder`, or the newest evaluation; raises ValueError if there is none."""
    chosen = folder or newest_evaluation()
    if chosen is None:
        raise ValueError("no evaluation found; run 'pa-console eval', or give a folder")
    if not chosen.is_dir():
        raise ValueError(f"{chosen}: there is no such folder")
    return chosen


def _made_here(
    results: EvaluationFolder,
    planned: list[Job],
    models: dict[str, LocalModel],
    lanes: int,
    *,
    reuse: bool,
    logs: bool,
) -> AsyncGenerator[RunRecord]:
    """Return an iterator over the runs, which are made in this process."""
    threads = max(1, physical_cores() // lanes)

    def engine_for(name: str, lane: int) -> MemoEngine:
        memory = results.folder / f"answers-{lane}-{models[name].fingerprint[:12]}.jsonl"
        engine = Engine(models[name], threads=threads)
        return MemoEngine(engine, memory if reuse else None, exact=True, reuse=reuse)

    return Runner(results, engine_for, lanes=lanes, keep_logs=logs).run(planned)


def _swept(
    results: EvaluationFolder,
    planned: list[Job],
    where: int | str,
    models: dict[str, LocalModel],
    names: dict[str, str | None],
    reader: str,
    *,
    reuse: bool,
    logs: bool,
) -> AsyncGenerator[RunRecord]:
    """Return an iterator over the runs, which are made on workers.

    `where` is the number of local processes, or the address of a scheduler. `names` has the name or
    file with which each model was requested. Raises ValueError if Dask is not installed.
    """
    with naming_what_is_missing("sweep", "a sweep needs"):
        from pa_console.evaluation.sweep import ModelOnWorker, Sweep, Workers  # noqa: PLC0415

    workers = Workers(count=where) if isinstance(where, int) else Workers(scheduler=where)
    prints = {name: model.fingerprint for name, model in models.items()}
    engine_for = ModelOnWorker(names, prints, reader, workers.count, reuse)
    sweep = Sweep(results, engine_for, prints, keep_logs=logs, report=errors.print)
    return sweep.run(workers, planned)


async def _count(
    made: AsyncGenerator[RunRecord], results: EvaluationFolder, planned: list[Job]
) -> None:
    """Make the runs by iterating over `made`, and show the progress."""
    done = results.done
    with EvalProgress(len(planned), sum(job.run in done for job in planned)) as progress:
        async with aclosing(made) as records:
            async for record in records:
                progress.add(record)


def sets_of(planned: Sequence[Job]) -> list[str]:
    """Return the names of the mission sets in `planned`."""
    return list(dict.fromkeys(job.mission_set for job in planned))


def _about(
    results: EvaluationFolder, sets: list[str], seconds: float, jobs: int, reuse: bool
) -> dict[str, object]:
    """Return the description of the runs for the report, merged with that in the folder."""
    before = read_about(results.folder)
    records = results.records
    return {
        "version": __version__,
        "machine": list(describe_machine().lines),
        "models": list(dict.fromkeys(record.model for record in records)),
        "variants": list(dict.fromkeys(record.variant for record in records)),
        "mission_sets": list(dict.fromkeys([*before.get("mission_sets", []), *sets])),
        "seeds": sorted({record.seed for record in records}),
        "runs": len(records),
        "seconds": round(seconds + float(before.get("seconds", 0.0)), 1),
        "jobs": max(jobs, int(before.get("jobs", 1))),
        "reuse": reuse or bool(before.get("reuse", False)),
    }


def _report(folder: Path, *, json: bool) -> None:
    """Write both reports and print the tables, or everything as JSON.

    Without the extra `eval`, only the tables are printed, and a line with the command that installs
    it.
    """
    from pa_console.evaluation.reporting.report import (  # noqa: PLC0415 - numpy is slow
        MARKDOWN,
        PAGE,
        build_tables,
        write_report,
    )

    records = read_runs(folder)
    if not records:
        raise ValueError(f"{folder}: no completed runs; make some with 'pa-console eval'")
    tables, files = build_tables(records), (PAGE, MARKDOWN)
    if missing := missing_library("matplotlib", "eval", f"{' and '.join(files)} need"):
        errors.print_line(missing, style="yellow")
        files = ()
    else:
        with errors.status("drawing the report"):
            write_report(folder, records, read_about(folder))
    if json:
        print_json({"folder": str(folder), "tables": tables, "runs": records})
        return
    for table in tables:
        out.print(to_rich(table, out.width))
        if table.note:
            out.print(table.note)
        out.print()
    for name in (*files, "runs.jsonl"):
        out.print_line(str(folder / name))
