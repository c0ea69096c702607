"""A judge's verdicts on the plans of an evaluation, against the truth."""

import asyncio
from collections import Counter
from collections.abc import Mapping
from contextlib import aclosing
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from pa_console.cli.options import ModelOption
from pa_console.cli.verbs.evaluate import to_rich
from pa_console.evaluation.memo_engine import MemoEngine
from pa_console.evaluation.reporting.statistics import ReportTable, fraction_cell, seconds
from pa_console.evaluation.run_record import RunRecord, read_runs
from pa_console.llm.backend import ModelUnavailableError
from pa_console.llm.local.engine import Engine
from pa_console.llm.models.catalogue import LocalModel, find_model
from pa_console.llm.roles.judge import Judge
from pa_console.llm.roles.role_model import PROMPT_FORMATS
from pa_console.schema.events.event import WorkerState
from pa_console.schema.text import count
from pa_console.terminal.output import errors, out
from tests.benchmarks.harness import JsonFileOption, keep
from tests.benchmarks.judge.cases import (
    CaseReader,
    JudgedCase,
    LeftOutError,
    choose_runs,
)
from tests.benchmarks.judge.verdicts import (
    JudgedRun,
    JudgeReport,
    Quality,
    Share,
    errors_of,
    judge_cases,
    qualities,
)


def show(report: JudgeReport) -> None:
    """Print the tables of `report` and the notes under them."""
    tables = [
        _confusion_table(report),
        _failure_table(report),
        _group_table("categories", "Verdicts on plans by category", report.categories),
    ]
    if len(report.by_planner) > 1:
        tables.append(_group_table("planners", "Verdicts on plans by planner", report.by_planner))
    for table in tables:
        out.print(to_rich(table, out.width))
        if table.note:
            out.print(table.note)
        out.print()
    notes = [
        f"judge {report.model} ({report.fingerprint[:12]}), plans of {', '.join(report.planners)}",
        f"the model was asked {count(report.asked, 'time')}, "
        f"{count(report.reused, 'prompt')} came again",
        f"left out: {counts(report.left_out)}",
    ]
    if report.own_plans:
        notes.append(f"{report.own_plans} of the plans are by the judge's own model")
    if report.changed:
        notes.append(
            f"in {count(report.changed, 'run')} the world's or the rules' file was another one"
        )
    notes += [
        f"no verdict, {count(times, 'time')}: {error}" for error, times in report.errors.items()
    ]
    for note in notes:
        out.print_line(note)


def _confusion_table(report: JudgeReport) -> ReportTable:
    return ReportTable(
        name="success",
        title=f"{report.model} against the truth: positive is Success",
        columns=("verdict on", "TP", "FP", "FN", "TN", "none", "precision", "recall", "F1"),
        rows=tuple(
            (
                line.name,
                *map(str, (line.tp, line.fp, line.fn, line.tn, line.silent)),
                *map(_cell, (line.success.precision, line.success.recall, line.success.f1)),
            )
            for line in report.total
        ),
        note=(
            "Truth: strict success on the true state. none: no verdict, in no rate. In brackets "
            "95 % intervals (Wilson). As logged: by the judge that the evaluation had."
        ),
    )


def _failure_table(report: JudgeReport) -> ReportTable:
    return ReportTable(
        name="failure",
        title="The same with Failure as the positive: what is caught",
        columns=("verdict on", "precision", "recall", "F1", "accuracy", "median s", "p95 s"),
        rows=tuple(
            (
                line.name,
                *map(_cell, (line.failure.precision, line.failure.recall, line.failure.f1)),
                _cell(line.accuracy),
                seconds(line.median_s),
                seconds(line.p95_s),
            )
            for line in report.total
        ),
        note="Seconds: of the model alone for a verdict, nothing of the picture read ahead.",
    )


def _group_table(name: str, title: str, lines: tuple[Quality, ...]) -> ReportTable:
    return ReportTable(
        name=name,
        title=title,
        columns=("of", "runs", "successes", "F1 Success", "F1 Failure", "median s", "p95 s"),
        rows=tuple(
            (
                line.name,
                str(line.runs),
                str(line.tp + line.fn),
                _cell(line.success.f1),
                _cell(line.failure.f1),
                seconds(line.median_s),
                seconds(line.p95_s),
            )
            for line in lines
        ),
    )


def _cell(share: Share | None) -> str:
    return fraction_cell((share.value, share.low, share.high) if share is not None else None)


def counts(left_out: Mapping[str, int]) -> str:
    """Return what was left out, with its reasons, in one line."""
    return ", ".join(f"{number} ({reason})" for reason, number in left_out.items()) or "none"


COLUMNS = (
    MofNCompleteColumn(),
    TextColumn("{task.description}", markup=False),
    TimeRemainingColumn(),
)


def judge(
    runs: Annotated[Path, typer.Argument(help="Folder of an evaluation whose logs were kept.")],
    model: ModelOption = None,
    variant: Annotated[
        list[str] | None, typer.Option(help="Only runs of this variant; repeatable.")
    ] = None,
    planner: Annotated[
        list[str] | None, typer.Option(help="Only plans of this model; repeatable.")
    ] = None,
    every: Annotated[int, typer.Option(min=1, help="Only every n-th run of each category.")] = 1,
    outcome: Annotated[
        bool, typer.Option(help="Ask for a verdict on the outcome of each plan too.")
    ] = True,
    world: Annotated[
        str | None, typer.Option(help="The runs' world, when it is not installed here.")
    ] = None,
    rules: Annotated[
        str | None, typer.Option(help="The runs' rules, when they are not installed here.")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("--out", help="Keep every answer in this folder, and go on from there."),
    ] = None,
    json: JsonFileOption = None,
) -> None:
    """Ask a judge about the executed plans of RUNS; compare its verdicts with the strict truth."""
    if not runs.is_dir():
        raise ValueError(f"{runs}: there is no such folder; 'pa-console eval --out' makes one")
    records, left_out = choose_runs(read_runs(runs), variant or (), planner or (), every)
    reader = CaseReader(runs, world, rules)
    local = find_model(model)
    with Progress(*COLUMNS, console=errors, transient=True) as progress:
        cases = _read(reader, records, left_out, progress)
        if not cases:
            raise ValueError(
                f"{runs}: no run here shows what its judge was given; left out: {counts(left_out)}"
            )
        asked = asyncio.run(_ask(cases, local, output, progress, outcomes=outcome))
    report = _report(runs, local, cases, left_out, *asked)
    show(report)
    keep("judge", report, json)


def _read(
    reader: CaseReader, records: list[RunRecord], left_out: Counter[str], progress: Progress
) -> list[JudgedCase]:
    """Return the cases of `records`; the reasons of those that hold none go to `left_out`."""
    task = progress.add_task("reading logs", total=len(records))
    cases: list[JudgedCase] = []
    for record in records:
        try:
            cases.append(reader.read(record))
        except LeftOutError as error:
            left_out[str(error)] += 1
        progress.advance(task)
    progress.remove_task(task)
    return cases


async def _ask(
    cases: list[JudgedCase],
    model: LocalModel,
    folder: Path | None,
    progress: Progress,
    *,
    outcomes: bool,
) -> tuple[list[JudgedRun], int, int]:
    """Return the verdicts on `cases`, how often the model was asked, and how often it was not.

    Raises ModelUnavailableError when the model cannot be loaded: no verdict then is no finding.
    """
    memory = None
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        memory = folder / f"answers-{model.fingerprint[:12]}.jsonl"
    unavailable: list[str] = []

    def watch(state: WorkerState, detail: str) -> None:
        if state == "unavailable":
            unavailable.append(detail)

    engine = MemoEngine(Engine(model, watch), memory, exact=True)
    task = progress.add_task("asking", total=len(cases))
    found: list[JudgedRun] = []
    right = 0
    try:
        room = PROMPT_FORMATS[model.prompts].verdict_tokens
        judge = Judge(engine, max_tokens=room)
        verdicts = judge_cases(cases, judge, model, outcomes=outcomes)
        async with aclosing(verdicts) as judged:
            async for run in judged:
                if unavailable:
                    raise ModelUnavailableError(f"{model.name}: {unavailable[0]}")
                found.append(run)
                right += (run.plan.verdict == "Success") == run.strict
                words = f"right about {right} of {len(found)}: {run.run}"
                progress.update(task, advance=1, description=words)
                if not errors.is_terminal:
                    said = run.plan.verdict or run.plan.error
                    truth = "Success" if run.strict else "Failure"
                    line = f"{len(found)}/{len(cases)} {run.run}: {said}, in truth {truth}"
                    errors.print_line(line)
    finally:
        await engine.close()
    return found, engine.asked, engine.reused


def _report(
    folder: Path,
    model: LocalModel,
    cases: list[JudgedCase],
    left_out: Counter[str],
    runs: list[JudgedRun],
    asked: int,
    reused: int,
) -> JudgeReport:
    total, categories, by_planner = qualities(runs)
    return JudgeReport(
        model=model.name,
        fingerprint=model.fingerprint,
        prompt_format=model.prompts,
        folder=str(folder),
        planners=tuple(dict.fromkeys(run.planner for run in runs)),
        left_out=dict(left_out.most_common()),
        changed=sum(case.changed for case in cases),
        own_plans=sum(run.own_plan for run in runs),
        asked=asked,
        reused=reused,
        total=total,
        categories=categories,
        by_planner=by_planner,
        errors=errors_of(runs),
        runs=tuple(runs),
    )
