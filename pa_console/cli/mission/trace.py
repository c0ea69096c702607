"""Prints a laid out trace on the terminal: what a mission's decision and its outcome rest on."""

from collections.abc import Iterable

from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from pa_console.schema.events.intake import QuestionAnswered
from pa_console.schema.text import visible
from pa_console.session.mission_trace import MissionTrace
from pa_console.views.status_words import Tone
from pa_console.views.trace.layout import answered, headline, lay_out, lay_out_proposal, progress
from pa_console.views.trace.parts import (
    Detail,
    HangingRow,
    Section,
    Span,
    TraceOptions,
    rows_of,
    title_of,
)

COLOURS: dict[Tone, str] = {
    "": "",
    "good": "green",
    "bad": "red",
    "warn": "yellow",
    "calm": "cyan",
    "quiet": "dim",
    "note": "magenta",
}
"""The terminal's colour for every tone."""

_OPTIONS = TraceOptions(Detail.BRIEF, evidence=True)


def print_trace(console: Console, trace: MissionTrace) -> None:
    """Print `trace` in the order of the eight steps, its end first."""
    _print_head(console, trace)
    console.print(_text(progress(trace)))
    _print_sections(console, lay_out(trace, {}, _OPTIONS))


def print_proposal(console: Console, trace: MissionTrace, number: int) -> None:
    """Print the rules and attempt `number` of a mission that waits for approval."""
    _print_head(console, trace)
    _print_sections(console, lay_out_proposal(trace, number, {}, _OPTIONS))


def print_answer(console: Console, told: QuestionAnswered) -> None:
    """Print the answer to a question that is about no mission, or about one printed before."""
    _print_sections(console, answered((told,)))


def _print_head(console: Console, trace: MissionTrace) -> None:
    console.print()
    for line in headline(trace):
        console.print(_text(line))


def _print_sections(console: Console, sections: Iterable[Section], indent: int = 0) -> None:
    """Print each section under its title, and the parts of it further in."""
    for section in sections:
        console.print(Padding(_text(title_of(section)), (0, 0, 0, indent), expand=False))
        for row in rows_of(section):
            console.print(Padding(_hanging(row), (0, 0, 0, indent), expand=False))
        _print_sections(console, section.parts, indent + 2)


def _hanging(row: HangingRow) -> Table:
    """Return a row whose body wraps beside its lead."""
    lead = _text(row.lead)
    grid = Table.grid()
    grid.add_column(no_wrap=True, overflow="fold")
    grid.add_column(overflow="fold")
    grid.add_row(lead, _text(row.body))
    return grid


def _text(spans: Iterable[Span]) -> Text:
    """Return a laid out text in the terminal's colours; what a terminal obeys is its escape."""
    return Text.assemble(
        *((visible(span.text), f"{span.stress} {COLOURS[span.tone]}".strip()) for span in spans)
    )
