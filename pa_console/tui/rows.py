"""Rows with a hanging indent, laid out for a width or as plain text; a trace consists of them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import cast

from textual.content import Content

from pa_console.schema.text import visible
from pa_console.tui.status_words import QUIET

Part = str | tuple[str, str] | Content

LEAST_BODY = 12

GAP = "  "
"""The separator between two phrases."""


@dataclass(frozen=True)
class WrappedRow:
    """A fixed `lead` and a `body` that wraps beside it.

    If the body consists of `phrases`, lines break between phrases where that is possible.
    """

    lead: Content
    body: Content
    phrases: tuple[Content, ...] = ()


@dataclass(frozen=True)
class RowSection:
    """One titled part of a trace; `key` identifies it while its content grows."""

    key: str
    title: Content
    rows: tuple[WrappedRow, ...]
    collapsed: bool = False


def row(lead: Sequence[Part] | Part = "", *body: Part) -> WrappedRow:
    """Build a row from texts, (text, style) pairs and contents; nothing is parsed as markup.

    Invisible characters are replaced with their escapes, so that they count in the width.
    """
    leads = lead if isinstance(lead, list) else [cast(Part, lead)]
    return WrappedRow(Content.assemble(*map(_seen, leads)), Content.assemble(*map(_seen, body)))


def phrased(lead: Sequence[Part] | Part, phrases: Iterable[Part]) -> WrappedRow:
    """Build a row of phrases; a phrase that fits on a line is not broken."""
    parts = tuple(Content.assemble(_seen(part)) for part in phrases)
    return replace(row(lead, Content(GAP).join(parts)), phrases=parts)


def _seen(part: Part) -> Part:
    match part:
        case str():
            return visible(part)
        case (text, style):
            return visible(text), style
        case _:
            return part


def column(text: str, width: int, style: str = "") -> tuple[str, str]:
    """Return `text`, cut or padded to `width` cells and followed by a space, and its style."""
    cut = text if len(text) <= width else text[: width - 1] + "…"
    return f"{cut:<{width}} ", style


def fact(name: str, *body: Part, width: int = 9) -> WrappedRow:
    """Return a row that begins with the name of a fact."""
    return row(column(name, width, QUIET), *body)


def layout(rows: Sequence[WrappedRow], width: int) -> list[Content]:
    """Return the lines of `rows` at `width` cells; without room, a body goes below its lead."""
    lines: list[Content] = []
    for item in rows:
        lead, body = item.lead, item.body
        beside = width - lead.cell_length
        if beside < LEAST_BODY and body:
            lines += lead.wrap(max(1, width))
            lead, beside = Content("  "), max(1, width - 2)
        if item.phrases:
            pieces = _filled(item.phrases, max(1, beside))
        else:
            pieces = body.wrap(max(1, beside)) if body else [Content()]
        lines.append(lead + pieces[0])
        hang = Content(" " * lead.cell_length)
        lines += [hang + piece for piece in pieces[1:]]
    return lines


def _filled(phrases: Sequence[Content], width: int) -> list[Content]:
    """Return the lines of phrases at `width` cells."""
    lines: list[Content] = []
    for phrase in phrases:
        if lines and lines[-1].cell_length + len(GAP) + phrase.cell_length <= width:
            lines[-1] = lines[-1] + GAP + phrase
        else:
            lines += phrase.wrap(width)
    return lines


def plain(sections: Sequence[RowSection]) -> str:
    """Return the whole content of the sections as text for the clipboard or a file."""
    lines: list[str] = []
    for section in sections:
        lines += ["", section.title.plain, "-" * section.title.cell_length]
        lines += [(item.lead.plain + item.body.plain).rstrip() for item in section.rows]
    return "\n".join(lines[1:]) + "\n"
