"""Searches a recording for words; what is found is listed while one types."""

import asyncio

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Vertical
from textual.content import Content
from textual.screen import ModalScreen
from textual.widgets import Input, Static

from pa_console.schema.text import clock_text
from pa_console.session.log.chain import LogError
from pa_console.session.recording import Recording
from pa_console.tui.rows import column
from pa_console.tui.status_words import NOTE, QUIET
from pa_console.tui.widgets.fields import LineField
from pa_console.tui.widgets.row_views import VirtualRows
from pa_console.views.event_words import Hit, kind_in_words, search

MOST = 500
STEP = 20_000
"""Events between two looks at whether something else was typed."""

HINT = "words in any order; Enter goes to the list, and there to the event; Esc goes back"


class HitRows(VirtualRows):
    """A row for each event that was found: when, which mission, what."""

    def __init__(self, recording: Recording, **kwargs: str) -> None:
        super().__init__(**kwargs)
        self._recording = recording
        self._hits: dict[str, Hit] = {}

    def show(self, hits: list[Hit]) -> None:
        """Show these."""
        self._hits = {str(hit.index): hit for hit in hits}
        self.set_keys(list(self._hits))

    def row(self, index: int, width: int) -> Content:
        """Return the row of one hit."""
        del width
        hit = self._hits[self.keys[index]]
        return Content.assemble(
            column(clock_text(self._recording.timeline.seconds[hit.index]), 7, QUIET),
            column(hit.mission, 9, "bold"),
            (f"{kind_in_words(hit.kind)}  ", NOTE),
            hit.excerpt,
        )


class FindEvent(ModalScreen[int | None]):
    """Returns the event that was chosen, or None; the pointer starts at the next one from here."""

    BINDINGS = [Binding("escape", "dismiss", "Back")]

    def __init__(self, recording: Recording, here: int) -> None:
        """`here` is how many events were played."""
        super().__init__()
        self._recording, self._here = recording, here

    def compose(self) -> ComposeResult:
        """Yield the field, the list and the number of matches."""
        with Vertical(id="find"):
            yield LineField(id="find-words", placeholder="words that an event says")
            yield HitRows(self._recording, id="find-list")
            yield Static(HINT, id="find-note", markup=False)

    def on_mount(self) -> None:
        """Start in the field."""
        self.query_one("#find").border_title = "Search"
        self.query_one(Input).focus()

    @on(Input.Changed)
    def _typed(self, event: Input.Changed) -> None:
        event.stop()
        self.run_worker(self._search(event.value), group="find", exclusive=True)

    @on(Input.Submitted)
    def _to_list(self, event: Input.Submitted) -> None:
        event.stop()
        if self.query_one(HitRows).keys:
            self.query_one(HitRows).focus()

    @on(VirtualRows.RowChosen)
    def _chosen(self, event: VirtualRows.RowChosen) -> None:
        event.stop()
        self.dismiss(int(event.key))

    async def _search(self, text: str) -> None:
        """Show the events with all the words of `text`, a part of the recording after the other."""
        hits: list[Hit] = []
        end = len(self._recording)
        try:
            for first in range(0, end, STEP):
                last = min(first + STEP, end)
                found = search(self._recording, text, first, last)
                hits += await asyncio.to_thread(list, found)
                if len(hits) >= MOST:
                    break
                if end > STEP:
                    self._note(f"{len(hits)} found in {last / end:.0%} of the recording")
        except LogError as error:
            self._note(str(error))
            return
        self._show(text, hits[:MOST])

    def _show(self, text: str, hits: list[Hit]) -> None:
        rows = self.query_one(HitRows)
        rows.show(hits)
        following = next((str(hit.index) for hit in hits if hit.index >= self._here), "")
        rows.point_at(following)
        first = f"the first {MOST}" if len(hits) == MOST else str(len(hits))
        self._note(f"{first} found; Enter goes to the list" if text.strip() else HINT)

    def _note(self, text: str) -> None:
        self.query_one("#find-note", Static).update(text)
