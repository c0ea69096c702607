"""The report of an evaluation: report.md with its figures, and report.html in a single file."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, cast

from pa_console.evaluation.jobs import ABOUT
from pa_console.evaluation.reporting.drawing import inline, render
from pa_console.evaluation.reporting.figures import (
    ABLATION,
    FAILURES,
    JUDGE,
    LATENCY,
    SUCCESS,
    Drawn,
    build_figures,
)
from pa_console.evaluation.reporting.statistics import (
    TEXTS,
    Records,
    ReportTable,
    by_model,
    by_set,
    main_runs,
    main_variant,
    needless_refusal,
    seconds,
)
from pa_console.evaluation.reporting.tables_judgement import (
    calibration_table,
    confidence_table,
    judge_tables,
    reading_table,
)
from pa_console.evaluation.reporting.tables_outcomes import (
    FailureKind,
    ablation_tables,
    decision_seconds,
    failure_kind,
    failure_tables,
    latency_tables,
    success_tables,
)
from pa_console.evaluation.run_record import RunRecord
from pa_console.schema.text import visible

MARKDOWN, PAGE, FIGURES = "report.md", "report.html", "figures"

FLAGS = {
    "failed": "not a strict success",
    "broke": "an enforced rule was broken",
    "judge": "the judge's verdict on the outcome was wrong",
    "refused": "refused needlessly",
    "obliged": "not refused, although it had to be",
}
"""The filters of the table of runs, in addition to the kinds of failure."""

_KNOWN = {"models", "variants", "mission_sets", "seeds", "runs", "seconds", "reuse"}


def facts(records: Records, about: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the facts about the runs as pairs of a name and a text; `about` is from run.json."""
    names = {record.variant for record in records}
    variants = [*(name for name in ABOUT if name in names), *sorted(names - ABOUT.keys())]
    sets = [
        f"{name} ({len({run.mission for run in runs})} missions)"
        for name, runs in by_set(records).items()
    ]
    entries = [
        ("runs", str(len(records))),
        ("models", ", ".join(by_model(records))),
        ("variants", "; ".join(f"{name}: {ABOUT[name]}" if name in ABOUT else name
                               for name in variants)),
        ("mission sets", ", ".join(sets)),
        ("worlds", ", ".join(dict.fromkeys(record.world for record in records))),
        ("seeds", ", ".join(str(seed) for seed in sorted({record.seed for record in records}))),
    ]  # fmt: skip
    if isinstance(seconds := about.get("seconds"), int | float):
        entries.append(("time taken", duration(seconds)))
    entries += [
        (key.replace("_", " "), _plain(value)) for key, value in about.items() if key not in _KNOWN
    ]
    return [(name, text) for name, text in entries if text]


def duration(seconds: float) -> str:
    """Return a time in hours and minutes, or in seconds if it is short."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes // 60} h {minutes % 60} min" if minutes >= 60 else f"{minutes} min"


def _plain(value: Any) -> str:
    """Return any JSON value in words."""
    if isinstance(value, Mapping):
        pairs = cast(Mapping[str, Any], value)
        return "; ".join(f"{key}: {_plain(entry)}" for key, entry in pairs.items())
    if isinstance(value, list | tuple):
        return "; ".join(map(_plain, cast(Sequence[Any], value)))
    if isinstance(value, bool):
        return "yes" if value else "no"
    return "" if value is None else str(value)


def notes(records: Records, about: Mapping[str, Any]) -> list[str]:
    """Return notes on the limits of the report's numbers, as far as the data show them."""
    main = main_runs(records)
    if not main:
        return ["There are no runs yet."]
    lines = [
        f"Tables and figures by model show the variant '{main_variant(records)}'; the ablation "
        "shows all variants.",
        "Intervals treat runs as independent. Runs of one mission with several seeds are often "
        "alike, because equal prompts have equal answers. Therefore, an interval shows how certain "
        "a number is for these missions, and less so for other missions.",
    ]
    counts = {model: frozenset(run.case for run in runs) for model, runs in by_model(main).items()}
    if len(set(counts.values())) > 1:
        words = ", ".join(f"{model} {len(cases)}" for model, cases in counts.items())
        lines.append(f"Not every model has run the same missions and seeds ({words}).")
    kind = sum(run.hybrid is True and not run.strict for run in main)
    harsh = sum(run.strict and run.hybrid is False for run in main)
    lines.append(
        f"Hybrid and strict disagree on {kind + harsh} of {len(main)} runs: {kind} are a success "
        f"only according to the judge, and {harsh} only according to the truth."
    )
    silent = sum(run.judge_outcome is None for run in main)
    if silent:
        lines.append(
            f"{silent} of {len(main)} runs have no verdict on the outcome, mostly because nothing "
            "was executed. They count in hybrid success as its definition says, and they are left "
            "out of the judge's rates."
        )
    reused = sum(run.reused > 0 for run in records)
    if reused:
        lines.append(
            f"{reused} of {len(records)} runs reused an answer that the model had given to an "
            "equal prompt before. Their latencies include the time measured for that answer."
        )
    ahead = sum(run.read_ahead for run in records)
    if ahead:
        lines.append(
            f"In {ahead} of {len(records)} runs, the model had read the picture before the command "
            "arrived, as in the console while an operator types. It read the command itself "
            "afterwards."
        )
    jobs = about.get("jobs", 1)
    if isinstance(jobs, int) and jobs > 1:
        lines.append(f"{jobs} runs were made at a time, so each had only a part of the machine.")
    return lines


def build_sections(records: Sequence[RunRecord]) -> dict[str, list[ReportTable]]:
    """Return the tables of each section of a report, without empty tables and sections."""
    sections: dict[str, list[ReportTable]] = {
        SUCCESS: success_tables(records),
        LATENCY: latency_tables(records),
        JUDGE: [
            *judge_tables(records),
            confidence_table(records),
            calibration_table(records),
            reading_table(records),
        ],
        ABLATION: ablation_tables(records),
        FAILURES: failure_tables(records),
    }
    filled = {title: [table for table in of if table.rows] for title, of in sections.items()}
    return {title: tables for title, tables in filled.items() if tables}


def build_tables(records: Sequence[RunRecord]) -> list[ReportTable]:
    """Return the tables for `records`; an empty list if there are no records.

    Tables by model show the main variant (`main_variant`), and ablations show all variants.
    """
    return [table for tables in build_sections(records).values() for table in tables]


class ReportFigure(NamedTuple):
    """A figure in a report, with its file for the Markdown and its SVG for the page."""

    drawn: Drawn
    file: str
    svg: str


class ReportSection(NamedTuple):
    """A section of a report."""

    title: str
    figures: list[ReportFigure]
    tables: list[ReportTable]


class RunRow(NamedTuple):
    """A run in the table of runs; `marks` are the filters that show it."""

    record: RunRecord
    marks: str
    decision: str


def write_report(folder: Path, records: Sequence[RunRecord], about: Mapping[str, Any]) -> None:
    """Write report.md, figures/ and report.html into `folder`; `about` is from run.json.

    Equal records give equal files. Raises ImportError without the extra `eval`, and OSError if
    `folder` cannot be written.
    """
    from jinja2 import (  # noqa: PLC0415 - in the extra
        Environment,
        FileSystemLoader,
        StrictUndefined,
        select_autoescape,
    )

    (folder / FIGURES).mkdir(parents=True, exist_ok=True)
    shown = [_write_figure(folder, drawn) for drawn in build_figures(records)]
    sections = [
        ReportSection(title, [figure for figure in shown if figure.drawn.section == title], tables)
        for title, tables in build_sections(records).items()
    ]
    kinds = _kinds(records)
    content = {
        "facts": facts(records, about),
        "notes": notes(records, about),
        "definitions": TEXTS.terms,
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
    """Return `text` with escapes, so that it appears unchanged in a cell of a Markdown table."""
    for sign in "\\|*_`<[":
        text = text.replace(sign, f"\\{sign}")
    return " ".join(text.split())


def _write_figure(folder: Path, drawn: Drawn) -> ReportFigure:
    svg, png = render(drawn.name, drawn.draw)
    file = f"{FIGURES}/{drawn.name}.svg"
    (folder / file).write_bytes(svg)
    (folder / FIGURES / f"{drawn.name}.png").write_bytes(png)
    return ReportFigure(drawn, file, inline(svg, drawn.alt))


def _kinds(records: Sequence[RunRecord]) -> dict[FailureKind, tuple[int, int]]:
    """Return the kinds of failure with their rank and count, the most common kind first."""
    counts = Counter(kind for record in records if (kind := failure_kind(record)) is not None)
    ranked = sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    return {kind: (number, count) for number, (kind, count) in enumerate(ranked)}


def _row(record: RunRecord, kinds: Mapping[FailureKind, tuple[int, int]]) -> RunRow:
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
    return RunRow(record, " ".join(names), seconds(decision_seconds(record)))
