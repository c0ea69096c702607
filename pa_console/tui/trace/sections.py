"""Draws a laid out trace on the screen: sections of rows, its headline and its progress."""

from collections.abc import Iterable

from textual.content import Content

from pa_console.schema.text import visible
from pa_console.session.mission_trace import MissionTrace
from pa_console.tui.status_words import STYLES
from pa_console.tui.trace.rows import Row, Section, row
from pa_console.views import trace_layout, trace_parts
from pa_console.views.trace_layout import lay_out
from pa_console.views.trace_parts import Span, TraceOptions, rows_of, title_of
from pa_console.views.trace_planning import Rules

_SHOWN = TraceOptions()


def sections(trace: MissionTrace, rules: Rules) -> list[Section]:
    """Return everything known of the mission, in the order in which it happened."""
    return [shown for part in lay_out(trace, rules, _SHOWN) for shown in drawn(part)]


def drawn(section: trace_parts.Section) -> list[Section]:
    """Return a section with its rows; its parts are rows of it, or follow it when it is open."""
    title = content(title_of(section))
    if section.collapsed:
        rows = (*_own_rows(section), *_spread(section.parts))
        return [Section(section.key, title, rows, collapsed=True)]
    own = Section(section.key, title, tuple(_own_rows(section)))
    return [own, *(shown for part in section.parts for shown in drawn(part))]


def _own_rows(section: trace_parts.Section) -> Iterable[Row]:
    return (Row(content(item.lead), content(item.body)) for item in rows_of(section))


def _spread(given: Iterable[trace_parts.Section]) -> list[Row]:
    """Return the rows of sections under their titles."""
    result: list[Row] = []
    for section in given:
        result += [row("", content(title_of(section))), *_own_rows(section)]
        result += _spread(section.parts)
    return result


def content(spans: Iterable[Span]) -> Content:
    """Return a laid out text in the theme's colours."""
    return Content.assemble(*((visible(span.text), _style(span)) for span in spans))


def _style(span: Span) -> str:
    return f"{span.stress} {STYLES[span.tone]}".strip()


def progress(trace: MissionTrace) -> Content:
    """Return the line that shows how far the mission is, or how it ended and why."""
    words = content(trace_layout.progress(trace))
    if trace.status is not None:
        return words
    step, last = trace_layout.step_of(trace), len(trace_layout.STEPS) - 1
    bar = Content.assemble(
        ("━━" * step, "$text-success"), ("━╸", "$text-accent"), ("──" * (last - step), "$faint")
    )
    return Content.assemble(bar, " ", words)


def headline(trace: MissionTrace) -> list[Row]:
    """Return the mission's id, origin and text, and where it stands in each workflow."""
    return [row("", content(line)) for line in trace_layout.headline(trace)]
