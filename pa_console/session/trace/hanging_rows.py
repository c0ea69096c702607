"""Sections as rows with a hanging indent, for whatever writes into cells of equal width."""

from collections.abc import Iterator
from dataclasses import dataclass

from pa_console.session.trace.parts import Block, Line, Section, Span, Spans, Table, Text

INDENT = Span("  ")


@dataclass(frozen=True)
class HangingRow:
    """A fixed `lead`, and a `body` that wraps beside it."""

    lead: Spans
    body: Spans


def rows_of(section: Section) -> tuple[HangingRow, ...]:
    """Return the rows of a section's own blocks, without those of its parts."""
    return tuple(row for block in section.blocks for row in _rows(block))


def title_of(section: Section) -> Spans:
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
        case Line():
            yield _line(block)
        case Table():
            yield from _table(block)
        case Text(text=text, caption=caption):
            if caption:
                yield HangingRow((INDENT,), (Span(caption, "note"),))
            yield from (HangingRow((INDENT,), (Span(line),)) for line in text.splitlines())


def _line(line: Line) -> HangingRow:
    lead = [Span(INDENT.text * (1 + line.depth))]
    if line.label:
        label = f"{line.label:<{line.width}} " if line.width else f"{line.label}: "
        lead.append(Span(label, line.label_tone))
    if line.mark is not None:
        lead += [line.mark, Span("  " if line.label else " ")]
    return HangingRow(tuple(lead), line.body)


def _table(table: Table) -> Iterator[HangingRow]:
    """Yield each row: columns with a width in line, the others after them, long texts below."""
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
