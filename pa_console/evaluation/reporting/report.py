"""Writes the report of an evaluation: report.md with its figures, and a report.html of one file."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from jinja2 import Environment, FileSystemLoader, StrictUndefined, select_autoescape

from pa_console.evaluation.record import RunRecord
from pa_console.evaluation.reporting.failure_kinds import FailureKind, failure_kind
from pa_console.evaluation.reporting.figure_style import Drawn, inline, render
from pa_console.evaluation.reporting.figures import build_figures
from pa_console.evaluation.reporting.latency import decision_seconds
from pa_console.evaluation.reporting.record_groups import needless_refusal
from pa_console.evaluation.reporting.report_text import DEFINITIONS, facts, notes
from pa_console.evaluation.reporting.table import Table, seconds
from pa_console.evaluation.reporting.tables import build_sections
from pa_console.schema.visible import visible

MARKDOWN, PAGE, FIGURES = "report.md", "report.html", "figures"

FLAGS = {
    "failed": "no strict success",
    "broke": "an enforced rule was broken",
    "judge": "the judge's verdict on the outcome was wrong",
    "refused": "refused without need",
    "obliged": "not refused, but had to be",
}
"""What the table of runs can be filtered by, beside the ways of failing."""


class Shown(NamedTuple):
    """A figure in a report: its file for the Markdown, its text for the page."""

    drawn: Drawn
    file: str
    svg: str


class Section(NamedTuple):
    """A part of a report."""

    title: str
    figures: list[Shown]
    tables: list[Table]


class Row(NamedTuple):
    """A run in the table of runs; `marks` are the filters that keep it."""

    record: RunRecord
    marks: str
    decision: str


def write_report(folder: Path, records: Sequence[RunRecord], about: Mapping[str, Any]) -> None:
    """Write report.md, figures/ and report.html into `folder`; `about` is its run.json.

    Equal records give equal files. Raises OSError when `folder` cannot be written.
    """
    (folder / FIGURES).mkdir(parents=True, exist_ok=True)
    shown = [_write_figure(folder, drawn) for drawn in build_figures(records)]
    sections = [
        Section(title, [one for one in shown if one.drawn.section == title], tables)
        for title, tables in build_sections(records).items()
    ]
    kinds = _kinds(records)
    content = {
        "facts": facts(records, about),
        "notes": notes(records, about),
        "definitions": DEFINITIONS,
        "sections": sections,
        "rows": [_row(record, kinds) for record in records],
        "flags": FLAGS,
        "kinds": [
            (f"k{number}", ", ".join(kind), count) for kind, (number, count) in kinds.items()
        ],
    }
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=select_autoescape(enabled_extensions=("html.jinja",), default=False),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["cell"] = markdown_cell
    for name in (MARKDOWN, PAGE):
        text = environment.get_template(f"{name}.jinja").render(content)
        (folder / name).write_text(visible(text), encoding="utf-8", newline="\n")


def markdown_cell(text: str) -> str:
    """Return `text` so that a cell of a Markdown table shows it as it is."""
    for sign in "\\|*_`<[":
        text = text.replace(sign, f"\\{sign}")
    return " ".join(text.split())


def _write_figure(folder: Path, drawn: Drawn) -> Shown:
    svg, png = render(drawn)
    file = f"{FIGURES}/{drawn.name}.svg"
    (folder / file).write_bytes(svg)
    (folder / FIGURES / f"{drawn.name}.png").write_bytes(png)
    return Shown(drawn, file, inline(svg, drawn))


def _kinds(records: Sequence[RunRecord]) -> dict[FailureKind, tuple[int, int]]:
    """Return the ways of failing, most common first, each with its number and its count."""
    counts: dict[FailureKind, int] = {}
    for record in records:
        kind = failure_kind(record)
        if kind is not None:
            counts[kind] = counts.get(kind, 0) + 1
    ranked = sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    return {kind: (number, count) for number, (kind, count) in enumerate(ranked)}


def _row(record: RunRecord, kinds: Mapping[FailureKind, tuple[int, int]]) -> Row:
    kind = failure_kind(record)
    verdict = record.judge_outcome
    marks = {
        "failed": not record.strict,
        "broke": bool(record.broken),
        "judge": verdict is not None and (verdict == "Success") != record.strict,
        "refused": needless_refusal(record),
        "obliged": record.expect == "refuse" and not record.refused,
    }
    names = [name for name, holds in marks.items() if holds]
    if kind is not None:
        names.append(f"k{kinds[kind][0]}")
    return Row(record, " ".join(names), seconds(decision_seconds(record)))
