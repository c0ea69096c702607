"""The trace of one mission: headline, progress, and foldable sections that grow in place."""

from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Vertical, VerticalScroll
from textual.content import Content
from textual.message import Message
from textual.widgets import Static

from pa_console.session.mission_trace import MissionTrace
from pa_console.tui.trace.rows import Section, row
from pa_console.tui.trace.sections import headline, progress, sections
from pa_console.tui.widgets.row_views import TextRows
from pa_console.views.trace_planning import Rules

NO_MISSION = "No mission yet. Type one below, for example what should be watched or moved where."


class SectionTitle(Static, can_focus=True):
    """A section's title; Enter or a click folds and unfolds the section."""

    BINDINGS = [Binding("enter", "fold", "Fold", show=False)]

    class Folded(Message):
        """The operator asked to fold or unfold."""

    def action_fold(self) -> None:
        """Ask the section to fold or unfold."""
        self.post_message(self.Folded())

    def on_click(self) -> None:
        """Ask the section to fold or unfold."""
        self.post_message(self.Folded())


class SectionView(Vertical):
    """One section; what the operator folded or unfolded stays so while it grows."""

    def __init__(self, section: Section) -> None:
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

    def show(self, section: Section) -> None:
        """Show the section's newer content."""
        shown = self._section
        renamed = not section.title.is_same(shown.title)
        self._section = section
        if renamed or bool(section.rows) != bool(shown.rows):
            self._label()
        self._sheet.show(section.rows)

    def on_section_title_folded(self, message: SectionTitle.Folded) -> None:
        """Fold or unfold."""
        message.stop()
        self._folded = not self._folded
        self._label()

    def _label(self) -> None:
        empty = not self._section.rows
        sign = " " if empty else "▸" if self._folded else "▾"
        self._title.update(Content.assemble((f"{sign} ", "$text-accent"), self._section.title))
        self._sheet.display = not (self._folded or empty)


class TracePane(Vertical):
    """Shows the trace of the selected mission; follows its end unless scrolled away from it."""

    def __init__(self, rules: Rules, nothing: str = NO_MISSION, **kwargs: str) -> None:
        """`nothing` is shown before the first mission."""
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
        """Show a mission's trace; the same mission again updates only what changed."""
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

    def _replace(self, parts: list[Section], body: Vertical) -> None:
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
