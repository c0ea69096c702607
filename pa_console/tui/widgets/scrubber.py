"""The bar of a replay: how far it has come, and where missions, alarms and troubles are."""

from itertools import groupby

from textual import events
from textual.content import Content
from textual.message import Message
from textual.widgets import Static

from pa_console.session.marks import MarkKind
from pa_console.session.timeline import Timeline
from pa_console.tui.vocabulary import QUIET, WARN, term

LEAST = 10


class Scrubber(Static):
    """One cell for each part of the recording, with the worst of what is marked there."""

    class Asked(Message):
        """The bar was clicked; `share` of the recording, 0 to 1, is before that place."""

        def __init__(self, share: float) -> None:
            super().__init__()
            self.share = share

    def __init__(self, timeline: Timeline, **kwargs: str) -> None:
        super().__init__(id=kwargs.get("id"), markup=False)
        self._timeline = timeline
        self._marks: list[MarkKind | None] = []
        self._position = 0.0

    @property
    def places(self) -> int:
        """How many cells the bar has."""
        return max(self.content_size.width, LEAST)

    def show(self, position: float) -> None:
        """Show that the replay stands at `position`, in seconds from the first event."""
        self._position = position
        if len(self._marks) != self.places:
            self._marks = self._timeline.marks_by_place(self.places)
        duration = self._timeline.duration
        share = position / duration if duration > 0 else 0.0
        now = min(int(share * self.places), self.places - 1)
        parts: list[tuple[str, str]] = []
        for place, kind in enumerate(self._marks):
            glyph, style = ("━", WARN) if place < now else ("─", QUIET)
            if kind is not None:
                mark = term("mark", kind)
                glyph, style = mark.glyph, f"bold {mark.style}"
            elif place == now:
                glyph, style = "┃", f"bold {WARN}"
            parts.append((glyph, f"{style} reverse" if place == now else style))
        runs = groupby(parts, key=lambda part: part[1])
        joined = (("".join(glyph for glyph, _ in run), style) for style, run in runs)
        self.update(Content.assemble(*joined), layout=False)

    def on_resize(self, _event: events.Resize) -> None:
        """Fit the bar to the new width."""
        self.show(self._position)

    def on_click(self, event: events.Click) -> None:
        """Ask to go to the place that was clicked."""
        place = event.get_content_offset(self)
        if place is not None:
            self.post_message(self.Asked((place.x + 0.5) / self.places))
