"""The parts of a laid out trace: sections of lines, tables and texts, as plain data.

Every front end draws these parts, so that a mission reads the same in all of them.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

from pa_console.views.status_words import Status, Tone


class Detail(IntEnum):
    """The detail of a trace; each level includes the one before it.

    BRIEF    the basis of a decision, or its outcome
    FULL     also the picture, prompts, the plan's JSON, texts of rules and unbroken rules
    RECORD   also verbatim answers, their cost, every reply and every attempt's picture
    """

    BRIEF = 1
    FULL = 2
    RECORD = 3


@dataclass(frozen=True)
class TraceOptions:
    """A front end's choice of detail; `evidence` adds the deciding telemetry to each attempt."""

    detail: Detail = Detail.FULL
    evidence: bool = False


@dataclass(frozen=True)
class Span:
    """A piece of text in one tone; it may come from a model and is never parsed as markup."""

    text: str
    tone: Tone = ""
    stress: Literal["", "bold", "italic"] = ""


Spans = tuple[Span, ...]

INDENT = Span("  ")


@dataclass(frozen=True)
class TraceLine:
    """One statement: a label, a status sign, and a body.

    `width` is the width of the label in cells, which is the same for lines in a column; without it,
    a colon follows the label. `depth` is the number of indents.
    """

    body: Spans = ()
    label: str = ""
    label_tone: Tone = ""
    mark: Span | None = None
    width: int = 0
    depth: int = 0


@dataclass(frozen=True)
class Column:
    """One column of a table.

    `width` is the minimum width of the cells of an aligned column; columns without one follow each
    other. `below` is the indent in cells of a column with long texts, which may be placed under
    their rows; it is 0 for other columns. A column without a `head` is only a decoration and is
    left out of documents.
    """

    head: str
    width: int = 0
    tone: Tone = ""
    stress: Literal["", "bold", "italic"] = ""
    right: bool = False
    below: int = 0


@dataclass(frozen=True)
class TraceTable:
    """Rows with the same kinds of facts; `gap` separates columns without a width."""

    columns: tuple[Column, ...]
    rows: tuple[Spans, ...]
    gap: str = " "


@dataclass(frozen=True)
class Text:
    """A quoted text of several lines; it is `verbatim` if every character matters."""

    text: str
    caption: str = ""
    verbatim: bool = False


Block = TraceLine | TraceTable | Text


@dataclass(frozen=True)
class TraceSection:
    """One titled part of a trace.

    `key` identifies the part while its content grows. `step` is its step of the mission, from 1 to
    10, or 0 for none. A `collapsed` section is folded at first.
    """

    key: str
    title: str
    blocks: tuple[Block, ...] = ()
    step: int = 0
    mark: Status | None = None
    note: str = ""
    parts: tuple["TraceSection", ...] = ()
    collapsed: bool = False
    tone: Tone = ""


Cell = Span | Status | str


def table(columns: Sequence[Column], rows: Iterable[Sequence[Cell]], gap: str = " ") -> TraceTable:
    """Build a table; a status becomes its sign, and a plain text gets its column's tone."""
    built = tuple(
        tuple(_cell(cell, column) for cell, column in zip(row, columns, strict=True))
        for row in rows
    )
    return TraceTable(tuple(columns), built, gap)


def _cell(cell: Cell, column: Column) -> Span:
    if isinstance(cell, str):
        return Span(cell, column.tone, column.stress)
    return sign(cell) if isinstance(cell, Status) else cell


def sign(status: Status) -> Span:
    """Return a status as glyph and word."""
    return Span(status.text, status.tone)


def statement(text: str, tone: Tone = "") -> TraceLine:
    """Build a line with one statement and no label."""
    return TraceLine((Span(text, tone),))


def labelled(label: str, text: str, tone: Tone = "", depth: int = 0) -> TraceLine:
    """Build a line with `text` after its label."""
    return TraceLine((Span(text, tone),), label, depth=depth)


@dataclass(frozen=True)
class HangingRow:
    """A row of cells of equal width: a fixed `lead`, and a `body` that wraps beside it."""

    lead: Spans
    body: Spans


def rows_of(section: TraceSection) -> tuple[HangingRow, ...]:
    """Return the rows of a section's own blocks, without those of its parts."""
    return tuple(row for block in section.blocks for row in _rows(block))


def title_of(section: TraceSection) -> Spans:
    """Return a section's title: words, a status sign, and a quiet note."""
    mark = section.mark
    parts = [Span(section.title, section.tone, "bold")]
    if mark is not None:
        parts.append(Span(f"  {mark.text}", mark.tone))
    if section.note:
        parts.append(Span(f"  {section.note}", "quiet"))
    return tuple(parts)


def _rows(block: Block) -> Iterator[HangingRow]:
    match block:
        case TraceLine():
            yield _line(block)
        case TraceTable():
            yield from _table(block)
        case Text(text=text, caption=caption):
            if caption:
                yield HangingRow((INDENT,), (Span(caption, "note"),))
            yield from (HangingRow((INDENT,), (Span(line),)) for line in text.splitlines())


def _line(line: TraceLine) -> HangingRow:
    lead = [Span(INDENT.text * (1 + line.depth))]
    if line.label:
        label = f"{line.label:<{line.width}} " if line.width else f"{line.label}: "
        lead.append(Span(label, line.label_tone))
    if line.mark is not None:
        lead += [line.mark, Span("  " if line.label else " ")]
    return HangingRow(tuple(lead), line.body)


def _table(table: TraceTable) -> Iterator[HangingRow]:
    """Yield the rows: aligned columns first, then the others, then long texts below."""
    widths = [
        max([column.width, *(len(row[place].text) for row in table.rows)]) if column.width else 0
        for place, column in enumerate(table.columns)
    ]
    for row in table.rows:
        lead: list[Span] = [INDENT]
        body: list[Span] = []
        below: list[HangingRow] = []
        for cell, column, width in zip(row, table.columns, widths, strict=True):
            if width:
                room = f"{cell.text:>{width}}" if column.right else f"{cell.text:<{width}}"
                lead.append(Span(f"{room} ", cell.tone, cell.stress))
            elif not cell.text:
                continue
            elif column.below:
                below.append(HangingRow((Span(" " * column.below),), (cell,)))
            else:
                body += [Span(table.gap), cell] if body else [cell]
        yield HangingRow(tuple(lead), tuple(body))
        yield from below
