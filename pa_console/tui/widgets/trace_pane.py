"""The trace of one mission: headline, progress, and foldable sections that grow in place."""

from collections.abc import Iterable

from textual import events
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Vertical, VerticalScroll
from textual.content import Content
from textual.widgets import Static

from pa_console.schema.text import visible
from pa_console.session.mission_trace import MissionTrace
from pa_console.tui.rows import RowSection, WrappedRow, plain, row
from pa_console.tui.status_words import STYLES
from pa_console.tui.widgets.row_views import TextRows
from pa_console.views import trace_layout, trace_parts
from pa_console.views.trace_layout import lay_out
from pa_console.views.trace_parts import Span, TraceOptions, rows_of, title_of
from pa_console.views.trace_planning import Rules

_SHOWN = TraceOptions()

NO_MISSION = "No mission yet. Type one below, for example what to watch, or what to move where."


def sections(trace: MissionTrace, rules: Rules) -> list[RowSection]:
    """Return the sections of the mission's trace, in the order of the events."""
    return [shown for part in lay_out(trace, rules, _SHOWN) for shown in drawn(part)]


def drawn(section: trace_parts.TraceSection) -> list[RowSection]:
    """Return a section with its rows, to which a folded section adds the rows of its parts.

    The parts of an open section follow it.
    """
    title = content(title_of(section))
    if section.collapsed:
        rows = (*_own_rows(section), *_spread(section.parts))
        return [RowSection(section.key, title, rows, collapsed=True)]
    own = RowSection(section.key, title, tuple(_own_rows(section)))
    return [own, *(shown for part in section.parts for shown in drawn(part))]


def _own_rows(section: trace_parts.TraceSection) -> Iterable[WrappedRow]:
    return (WrappedRow(content(item.lead), content(item.body)) for item in rows_of(section))


def _spread(parts: Iterable[trace_parts.TraceSection]) -> list[WrappedRow]:
    """Return the rows of sections under their titles."""
    result: list[WrappedRow] = []
    for section in parts:
        result += [row("", content(title_of(section))), *_own_rows(section)]
        result += _spread(section.parts)
    return result


def content(spans: Iterable[Span]) -> Content:
    """Return laid-out text in the theme's colours."""
    return Content.assemble(*((visible(span.text), _style(span)) for span in spans))


def _style(span: Span) -> str:
    return f"{span.stress} {STYLES[span.tone]}".strip()


def progress(trace: MissionTrace) -> Content:
    """Return the line with the progress of the mission, or with its end and the reason."""
    words = content(trace_layout.progress(trace))
    if trace.status is not None:
        return words
    step, last = trace_layout.step_of(trace), len(trace_layout.STEPS)
    bar = Content.assemble(
        ("━━" * step, "$text-success"), ("━╸", "$text-accent"), ("──" * (last - step), "$faint")
    )
    return Content.assemble(bar, " ", words)


def headline(trace: MissionTrace) -> list[WrappedRow]:
    """Return the mission's id, origin and text, and its phase in each workflow."""
    return [row("", content(line)) for line in trace_layout.headline(trace)]


def trace_text(trace: MissionTrace, rules: Rules) -> str:
    """Return the whole trace as text, folded sections included."""
    mission = trace.mission
    head = f"{mission.id}  {mission.created:%Y-%m-%d %H:%M:%S} UTC\n{mission.said}\n"
    head += f"read as: {mission.text}\n" if mission.typed else ""
    return head + plain(sections(trace, rules))


class SectionTitle(Static, can_focus=True):
    """The title of a section."""


class SectionView(Vertical):
    """A section; Enter or a click on its title folds it, and it stays folded while it grows."""

    BINDINGS = [Binding("enter", "fold", "Fold", show=False)]

    def __init__(self, section: RowSection) -> None:
        super().__init__()
        self._section = section
        self._title = SectionTitle()
        self._sheet = TextRows(section.rows)
        self._folded = section.collapsed

    def compose(self) -> ComposeResult:
        """Yield the title and the rows."""
        yield self._title
        yield self._sheet

    def on_mount(self) -> None:
        """Show the title with its fold sign."""
        self._label()

    def show(self, section: RowSection) -> None:
        """Show the section's newer content."""
        shown = self._section
        renamed = not section.title.is_same(shown.title)
        self._section = section
        if renamed or bool(section.rows) != bool(shown.rows):
            self._label()
        self._sheet.show(section.rows)

    def on_click(self, event: events.Click) -> None:
        """Fold or unfold by a click on the title."""
        if event.widget is self._title:
            self.action_fold()

    def action_fold(self) -> None:
        """Fold or unfold."""
        self._folded = not self._folded
        self._label()

    def _label(self) -> None:
        empty = not self._section.rows
        sign = " " if empty else "▸" if self._folded else "▾"
        self._title.update(Content.assemble((f"{sign} ", "$text-accent"), self._section.title))
        self._sheet.display = not (self._folded or empty)


class TracePane(Vertical):
    """The trace of the selected mission; it follows the end unless it is scrolled away from it."""

    def __init__(self, rules: Rules, nothing: str = NO_MISSION, **kwargs: str) -> None:
        """Show the text `nothing` before the first mission."""
        super().__init__(id=kwargs.get("id"))
        self._rules = rules
        self._nothing = row("", (nothing, "$quiet"))
        self._trace: MissionTrace | None = None
        self._views: dict[str, SectionView] = {}
        self.border_title = "Trace"

    def compose(self) -> ComposeResult:
        """Yield the fixed head and the scrolled sections."""
        yield TextRows((self._nothing,), id="trace-head")
        yield Static("", id="trace-progress", markup=False)
        with VerticalScroll(id="trace-body"):
            yield Vertical(id="trace-sections")

    def on_mount(self) -> None:
        """Keep the newest section in view."""
        self.query_one("#trace-body", VerticalScroll).anchor()

    def show(self, trace: MissionTrace | None) -> None:
        """Show a mission's trace; for the same mission, update only what has changed."""
        body = self.query_one("#trace-body", VerticalScroll)
        if self._trace is None or trace is None or trace.mission.id != self._trace.mission.id:
            for view in self._views.values():
                view.remove()
            self._views = {}
            body.anchor()
        self._trace = trace
        head = headline(trace) if trace is not None else [self._nothing]
        self.query_one("#trace-head", TextRows).show(tuple(head))
        self._show_progress()
        parts = sections(trace, self._rules) if trace else []
        self._replace(parts, self.query_one("#trace-sections", Vertical))

    def _replace(self, parts: list[RowSection], body: Vertical) -> None:
        keys = {part.key for part in parts}
        for gone in [key for key in self._views if key not in keys]:
            self._views.pop(gone).remove()
        after: SectionView | None = None
        for part in parts:
            view = self._views.get(part.key)
            if view is None:
                view = self._views[part.key] = SectionView(part)
                if after is None:
                    body.mount(view, before=0 if body.children else None)
                else:
                    body.mount(view, after=after)
            else:
                view.show(part)
            after = view

    def _show_progress(self) -> None:
        line = self.query_one("#trace-progress", Static)
        line.update(progress(self._trace) if self._trace else "")
