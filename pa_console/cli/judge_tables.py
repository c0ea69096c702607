"""The tables of `pa-console bench judge`."""

from collections.abc import Mapping

from pa_console.cli.eval_tables import to_rich
from pa_console.cli.output import out
from pa_console.evaluation.judge_quality import JudgeReport, Quality, Share
from pa_console.evaluation.reporting.table import Table, fraction_cell, seconds
from pa_console.tui.words import count


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
            out.print(table.note, markup=False)
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
        out.print(note, markup=False, soft_wrap=True)


def _confusion_table(report: JudgeReport) -> Table:
    return Table(
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


def _failure_table(report: JudgeReport) -> Table:
    return Table(
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


def _group_table(name: str, title: str, lines: tuple[Quality, ...]) -> Table:
    return Table(
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
