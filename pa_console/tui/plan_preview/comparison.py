"""Sound plans side by side: the one that waits, other readings, other ways to do the same."""

from collections.abc import Callable, Iterable

from textual import events
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, VerticalScroll
from textual.content import Content
from textual.screen import Screen
from textual.widgets import Static

from pa_console.schema.text import count
from pa_console.tui.actions.keymap import ALT_DIGITS, READING_KEYS
from pa_console.tui.plan_preview.candidate import Candidate, candidate_rows
from pa_console.tui.widgets.bars import KeyFooter
from pa_console.tui.widgets.row_views import TextRows

LIST_CELLS = 100
"""The width below which plans stand one below the other."""


class CandidateColumn(VerticalScroll, can_focus=True):
    """One plan, scrolled by itself."""

    def __init__(self, candidate: Candidate) -> None:
        super().__init__(classes="candidate")
        self.candidate = candidate
        self.border_title = candidate.title

    def compose(self) -> ComposeResult:
        """Yield the facts to compare."""
        yield TextRows()

    def on_mount(self) -> None:
        """Fill in the rows."""
        self.query_one(TextRows).show(tuple(candidate_rows(self.candidate)))


class PlanComparison(Screen[Candidate | None]):
    """Plans in columns, on narrow terminals as a list; Enter chooses the one at the pointer.

    Nothing is approved here: what is chosen is checked, judged and put to the operator like any
    other plan. It is left with the plan that was chosen, with None for none.
    """

    BINDINGS = [
        Binding("escape", "leave", "Back"),
        Binding("enter", "choose", "Choose"),
        Binding("left,up", "point(-1)", "Before", show=False),
        Binding("right,down", "point(1)", "Next", show=False),
        *(
            Binding(f"{key},{alias}", f"point_at({n})", "Point at it", show=False)
            for n, (key, alias) in enumerate(zip(READING_KEYS, ALT_DIGITS, strict=True), start=1)
        ),
    ]

    def __init__(
        self,
        first: Candidate,
        begin: "Callable[[PlanComparison], object]",
        ended: Callable[[], object],
    ) -> None:
        """Begin with the plan that waits, or was the last one.

        `begin` is called once others can be added, and `ended` when the screen is left.
        """
        super().__init__()
        self._first, self._begin, self._ended = first, begin, ended

    def compose(self) -> ComposeResult:
        """Yield the title, the columns and the present search."""
        yield Static(id="comparison-title", markup=False)
        with Horizontal(id="comparison-plans"):
            yield CandidateColumn(self._first)
        yield Static(id="comparison-note", markup=False)
        yield KeyFooter()

    @property
    def columns(self) -> list[CandidateColumn]:
        """The plans, the present one first."""
        return list(self.query(CandidateColumn).results(CandidateColumn))

    def on_mount(self) -> None:
        """Point at the first plan."""
        self.columns[0].focus()
        self.tell("looking for other plans; Esc ends that")
        self._begin(self)

    def on_unmount(self) -> None:
        """Look for nothing any more."""
        self._ended()

    def on_resize(self, event: events.Resize) -> None:
        """Stand side by side where there is room."""
        self.set_class(event.size.width < LIST_CELLS, "-list")

    def add(self, candidate: Candidate) -> None:
        """Show one more plan; the pointer stays."""
        self.query_one("#comparison-plans", Horizontal).mount(CandidateColumn(candidate))

    def tell(self, text: str) -> None:
        """Show the present search, or that there is none."""
        self.query_one("#comparison-note", Static).update(Content(f" {text}"))
        title = f" PLANS SIDE BY SIDE  {count(len(self.columns), 'plan')}"
        self.query_one("#comparison-title", Static).update(Content(title))

    def action_point(self, by: int) -> None:
        """Point at the plan before or after."""
        columns = self.columns
        self._point((self._pointed(columns) + by) % len(columns))

    def action_point_at(self, number: int) -> None:
        """Point at another plan by its number."""
        self._point(number)

    def _point(self, index: int) -> None:
        for column in self.columns[index : index + 1]:
            column.focus()

    def _pointed(self, columns: Iterable[CandidateColumn]) -> int:
        return next((n for n, each in enumerate(columns) if each.has_focus), 0)

    def action_choose(self) -> None:
        """Choose the plan at the pointer; the one that waits is gone back to."""
        columns = self.columns
        self.dismiss(columns[self._pointed(columns)].candidate)

    def action_leave(self) -> None:
        """Go back without a choice."""
        self.dismiss(None)
