"""The recorded sessions, a row each, and the details of the one at the pointer."""

from collections.abc import Sequence
from typing import ClassVar

from textual.binding import Binding, BindingType

from pa_console.schema.text import clock_text
from pa_console.session.past_sessions import SessionSummary, Soundness
from pa_console.tui.status_words import QUIET, term
from pa_console.tui.trace.rows import Row, row
from pa_console.tui.widgets.row_views import Cells, Layout, PointedRows
from pa_console.views.status_words import outcomes_in_words

_LEAST = Layout(
    "begun",
    (("begun", 16), ("title", 20), ("scenario", 14), ("missions", 8), ("outcomes", 16),
     ("length", 7), ("log", 12)),
    ("scenario", "missions", "length", "begun"),
)  # fmt: skip


def session_layout(width: int) -> Layout:
    """Return the columns that fit into `width` cells; title and outcomes get what is left."""
    columns = _LEAST.fitting(width - 1)
    room = max(0, width - sum(cells + 1 for _, cells in columns))
    more = {"title": room - room // 3, "outcomes": room // 3}
    first = columns[0][0]
    return Layout(first, tuple((name, cells + more.get(name, 0)) for name, cells in columns), ())


class SessionRows(PointedRows):
    """The list of sessions, newest first; a session that is marked is to be compared."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("enter", "choose", "Open")]

    def __init__(self, **kwargs: str) -> None:
        super().__init__(**kwargs)
        self._sessions: dict[str, SessionSummary] = {}
        self._standings: dict[str, Soundness] = {}
        self.marked = ""

    @property
    def session(self) -> SessionSummary | None:
        """The session at the pointer."""
        return self._sessions.get(self.cursor)

    def show(self, sessions: Sequence[SessionSummary]) -> None:
        """Show these sessions."""
        self._sessions = {str(summary.log): summary for summary in sessions}
        self.set_keys(list(self._sessions))

    def standing(self, key: str) -> Soundness | None:
        """Return the state of the log `key`; None while it is being checked."""
        return self._standings.get(key)

    def stand(self, key: str, standing: Soundness) -> None:
        """Note how sound the log `key` is."""
        self._standings[key] = standing
        self.set_keys(self.keys)

    def mark(self, key: str) -> None:
        """Mark the session `key`, no other; none with an empty key."""
        self.marked = key
        self.set_keys(self.keys)

    def layout_of(self, width: int) -> Layout:
        """Return the columns that fit."""
        return session_layout(width)

    def cells(self, key: str) -> Cells:
        """Return the cells of a session."""
        summary, standing = self._sessions[key], self._standings.get(key)
        mark = term("log", standing.standing) if standing is not None else None
        title = f"≠ {summary.title}" if key == self.marked else summary.title
        return {
            "begun": (summary.local_start[:16], QUIET),
            "title": (title, "bold"),
            "scenario": (summary.scenario or "–", QUIET),
            "missions": (f"{len(summary.missions)}", ""),
            "outcomes": (outcomes_in_words(summary.outcomes), ""),
            "length": (clock_text(summary.length_s), QUIET),
            "log": (f"{mark.glyph} {mark.word}", mark.style) if mark else ("checking …", QUIET),
        }


def detail_rows(summary: SessionSummary, standing: Soundness | None) -> tuple[Row, ...]:
    """Return everything that the list has no room for: every mission, and why the log is sound."""
    running = standing is not None and standing.standing == "running"
    never = "not yet" if running else "its log was never closed"
    ended = never if summary.ending == "open" else summary.reason
    rows = [
        _line("session", f"{summary.session}, {clock_text(summary.length_s)} long"),
        _line("world", f"{summary.world}, rules {summary.rules}, seed {summary.seed}"),
        _line("scenario", summary.scenario or "none"),
        _line("model", summary.model),
        _line("ended", ended),
    ]
    if standing is not None:
        mark = term("log", standing.standing)
        told = f": {standing.detail}" if standing.detail else ""
        rows.append(row([("log       ", QUIET)], mark.content, told))
    for mission in summary.missions:
        mark = term("mission", mission.status or "open")
        rows.append(row([("mission   ", QUIET)], (f"{mission.id} ", "bold"), mark.content,
                        f"  {mission.origin}{mission.said}"))  # fmt: skip
        if mission.reason:
            rows.append(row("            ", (mission.reason, QUIET)))
    rows.append(_line("file", str(summary.log)))
    return tuple(rows)


def _line(name: str, text: str) -> Row:
    return row([(f"{name:<10}", QUIET)], text)
