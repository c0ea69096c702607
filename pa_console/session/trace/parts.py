"""What a laid out trace is made of: sections with lines, tables and texts, without any look.

A front end draws these and nothing else, so that all of them tell a mission alike.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

from pa_console.session.status_words import Status, Tone


class Detail(IntEnum):
    """How much is told; each level has all that the one before it has.

    BRIEF    what a decision or its outcome rests on
    FULL     also the picture, prompts, the plan's JSON, texts of rules and the rules that stand
    RECORD   also answers word for word, what they cost, every reply and every attempt's picture
    """

    BRIEF = 1
    FULL = 2
    RECORD = 3


@dataclass(frozen=True)
class TraceOptions:
    """What a front end wants to be told of a mission.

    `evidence` adds to each attempt the telemetry that decided it.
    """

    detail: Detail = Detail.FULL
    evidence: bool = False


@dataclass(frozen=True)
class Span:
    """A piece of text in one tone; it may come from a model, so nothing in it is markup."""

    text: str
    tone: Tone = ""
    stress: Literal["", "bold", "italic"] = ""


Spans = tuple[Span, ...]


@dataclass(frozen=True)
class Line:
    """One statement: a label, a status sign, and what is said.

    `width` is the room that the labels of such lines are given to be one below the other, in
    cells; without it a colon follows the label. `depth` is how many steps it is indented.
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

    `width` is the room that it takes at least, in cells, where columns stand one below the other;
    those without one follow each other. A column with `below`, in cells of indent, is a long text
    that may stand under its row. One without a `head` adorns: only what is read at a glance has it.
    """

    head: str
    width: int = 0
    tone: Tone = ""
    stress: Literal["", "bold", "italic"] = ""
    right: bool = False
    below: int = 0


@dataclass(frozen=True)
class Table:
    """Things of one kind with the same facts about each; `gap` parts columns without a width."""

    columns: tuple[Column, ...]
    rows: tuple[Spans, ...]
    gap: str = " "


@dataclass(frozen=True)
class Text:
    """A text that somebody else wrote, line by line; `verbatim` if each character counts."""

    text: str
    caption: str = ""
    verbatim: bool = False


Block = Line | Table | Text


@dataclass(frozen=True)
class Section:
    """One titled part of a trace.

    `key` says which part it is while its content grows, `step` which of the paper's steps it
    belongs to, from 1 to 8, and 0 for none. `collapsed` is what is not read at first.
    """

    key: str
    title: str
    blocks: tuple[Block, ...] = ()
    step: int = 0
    mark: Status | None = None
    note: str = ""
    parts: tuple["Section", ...] = ()
    collapsed: bool = False
    tone: Tone = ""


Cell = Span | Status | str


def table(columns: Sequence[Column], rows: Iterable[Sequence[Cell]], gap: str = " ") -> Table:
    """Build a table; a status becomes its sign, and a plain text takes its column's look."""
    built = tuple(
        tuple(_cell(cell, column) for cell, column in zip(row, columns, strict=True))
        for row in rows
    )
    return Table(tuple(columns), built, gap)


def _cell(cell: Cell, column: Column) -> Span:
    if isinstance(cell, str):
        return Span(cell, column.tone, column.stress)
    return sign(cell) if isinstance(cell, Status) else cell


def sign(status: Status) -> Span:
    """Return a status as glyph and word."""
    return Span(status.text, status.tone)


def said(text: str, tone: Tone = "") -> Line:
    """Build a line that is one statement."""
    return Line((Span(text, tone),))


def labelled(label: str, text: str, tone: Tone = "", depth: int = 0) -> Line:
    """Build a line that says what `text` is."""
    return Line((Span(text, tone),), label, depth=depth)
