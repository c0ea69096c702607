"""All keys, from the action registry, and the meaning of every sign, from the vocabulary."""

from collections.abc import Mapping, Sequence
from itertools import groupby

from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import VerticalScroll
from textual.screen import ModalScreen

from pa_console.tui.actions import ACTIONS, GROUPS, ActionContext, key_text, shown_keys
from pa_console.tui.rows import WrappedRow, column, row
from pa_console.tui.status_words import NOTE, QUIET, TERMS
from pa_console.tui.widgets.row_views import TextRows

_APPROVAL = (
    ("r m a", "Go to Reject, Modify or Approve, or to what Approve still needs; Enter presses it"),
    ("Alt+1 … 3", "Plan anew for what an unclear order was meant to ask, where that is offered"),
    ("Alt+C", "Other sound plans side by side; nothing is approved there"),
    ("letters", "Any other letter, and what is pasted, begins the reason; Enter leaves it"),
    ("Tab", "Round the buttons, the warnings and the reason; Esc leaves"),
    ("", "Keys are dropped for the first 0.6 s, so that no stray key decides"),
)  # fmt: skip
_PROMPT = (
    ("Enter", "Send the mission; ^j or alt+Enter begins a new line"),
    ("Why? …", "A question is answered: why, why not another, what instead; a plan still waits"),
    ("↑ ↓", "Missions typed before"),
    ("Tab →", "Take the name that is shown in grey; Tab again tries the next, or goes to a slot"),
    ("Alt+1 … 4", "Before the first mission: type an example"),
    ("Esc", "Leave the field; the text stays"),
)


LETTER_WAITS = " (a letter waits for Enter)"


def help_rows(
    now: ActionContext, keymap: Mapping[str, str] | None = None, here: Sequence[Binding] = ()
) -> list[WrappedRow]:
    """Return the help page with the user's keys; an action that is not legal now says why.

    The keys of the screen that is open, `here`, come first.
    """
    rows: list[WrappedRow] = []
    if here:
        rows.append(row("", ("On this screen", f"bold {NOTE}")))
        rows += [
            row(["  ", column(key_text(each.key), 10, "bold")], each.description) for each in here
        ]
    for group in GROUPS:
        rows.append(row("", (group, f"bold {NOTE}")))
        for action in ACTIONS:
            if action.group == group:
                why = action.refusal(now)
                rows.append(
                    row(
                        ["  ", column(shown_keys(action, keymap or {}), 10, "bold")],
                        action.help + LETTER_WAITS * action.confirmed,
                        (f"  (now: {why})" if why else "", QUIET),
                    )
                )
    for name, keys in (("In the approval panel", _APPROVAL), ("In the mission field", _PROMPT)):
        rows.append(row("", (name, f"bold {NOTE}")))
        rows += [row(["  ", column(key, 10, "bold")], text) for key, text in keys]
    rows.append(row("", ("Signs", f"bold {NOTE}")))
    for family, items in groupby(TERMS.items(), key=lambda item: item[0].split(".")[0]):
        parts: list[tuple[str, str] | str] = []
        for _, mark in items:
            parts += [mark.part, "   "]
        rows.append(row(["  ", column(family, 10, QUIET)], *parts))
    signs = "■ vehicle   ▪ person   D1→ asset and heading   • route   · lane   ╱ restricted zone"
    rows.append(row(["  ", column("map", 10, QUIET)], signs))
    return rows


class HelpScreen(ModalScreen[None]):
    """The help page; any of Escape, F1, q or ? closes it, M goes on to the manual."""

    BINDINGS = [
        Binding("escape,f1,q,question_mark", "dismiss", "Close"),
        Binding("m,M", "app.carry_out('manual')", "Manual"),
    ]

    def __init__(self, rows: Sequence[WrappedRow]) -> None:
        super().__init__()
        self._rows = tuple(rows)

    def compose(self) -> ComposeResult:
        """Yield the page."""
        with VerticalScroll(id="help"):
            yield TextRows(self._rows)

    def on_mount(self) -> None:
        """Name the page and let the arrow keys scroll it."""
        page = self.query_one("#help", VerticalScroll)
        page.border_title = "Help"
        page.border_subtitle = "M opens the manual, Esc closes"
        page.focus()
