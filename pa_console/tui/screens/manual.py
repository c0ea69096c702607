"""The manual with its pages and a search, and the list of all keys and signs."""

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import NamedTuple

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, VerticalScroll
from textual.content import Content
from textual.screen import ModalScreen, Screen
from textual.widgets import Input, Markdown, OptionList, Static
from textual.widgets.option_list import Option

from pa_console.manual_pages import Manual, Page
from pa_console.tui.actions import ACTIONS, GROUPS, ActionContext, key_text, shown_keys
from pa_console.tui.rows import WrappedRow, column, row
from pa_console.tui.status_words import NOTE, QUIET, TERMS
from pa_console.tui.widgets.bars import KeyFooter
from pa_console.tui.widgets.fields import LineField
from pa_console.tui.widgets.row_views import TextRows

FOUND = "-found"
"""The style class of the heading that was found."""

_APPROVAL = (
    ("r m a", "Go to Reject, Modify or Approve, or to what Approve still needs; Enter presses it"),
    ("Alt+1 … 3", "Show another reading of an unclear order, if one is offered; Enter chooses it"),
    ("Alt+C", "Compare other plans side by side; this approves nothing"),
    ("letters", "Any other letter, or pasted text, begins the reason; Enter leaves the field"),
    ("Tab", "Go through the buttons, the warnings and the reason; Esc leaves the panel"),
    ("", "Keys are ignored for the first 0.6 s, so that no stray key decides"),
)  # fmt: skip
_PROMPT = (
    ("Enter", "Send the mission; ^j or alt+Enter begins a new line"),
    ("Why? …", "Ask why, why not another asset, or what instead; a waiting plan is kept"),
    ("↑ ↓", "Recall earlier missions"),
    ("Tab →", "Complete the name shown in grey; Tab again tries the next name or goes to a slot"),
    ("Alt+1 … 4", "Before the first mission: type an example"),
    ("Esc", "Leave the field; the text stays"),
)
LETTER_WAITS = " (after a letter key, press Enter)"


class PagePosition(NamedTuple):
    """A page, and the number of the heading in it that is at the top of the screen."""

    page: Page
    heading: int = 0


class ManualScreen(Screen[None]):
    """The manual; typed words replace the list of pages with the sections that have the words."""

    BINDINGS = [Binding("escape", "dismiss", "Back"), Binding("slash", "search", "Search")]

    def __init__(self, manual: Manual) -> None:
        super().__init__()
        self._manual = manual
        self._places = [PagePosition(page) for page in manual.pages]
        self._wanted = self._places[0]
        self._shown: PagePosition | None = None
        self._busy = False

    def compose(self) -> ComposeResult:
        """Yield the search line, the list, the page and the keys."""
        yield Static(id="manual-title", markup=False)
        yield LineField(id="manual-search", placeholder="Words to find in all pages")
        with Horizontal(id="manual-body"):
            yield OptionList(id="manual-list", markup=False)
            with VerticalScroll(id="manual-page"):
                yield Markdown(id="manual-text", open_links=False)
        yield KeyFooter()

    def on_mount(self) -> None:
        """List all pages, with the pointer on the first."""
        self._list_pages()
        self.query_one("#manual-list").focus()

    @on(Input.Changed, "#manual-search")
    def _search(self, event: Input.Changed) -> None:
        words = event.value.strip()
        if not words:
            self._list_pages()
            return
        hits = self._manual.search(words)
        self._places = [PagePosition(hit.page, hit.number) for hit in hits]
        self._list(
            [
                Content.assemble(
                    (f" {hit.heading}", "bold"),
                    (f"  {hit.page.title}" if hit.number else "", QUIET),
                    "\n",
                    (f" {hit.excerpt}", QUIET),
                )
                for hit in hits
            ]
        )
        sections = "section has" if len(hits) == 1 else "sections have"
        self._title(f"{len(hits) or 'no'} {sections} these words")

    @on(Input.Submitted, "#manual-search")
    def _to_list(self) -> None:
        if self._places:
            self.query_one("#manual-list").focus()

    @on(OptionList.OptionHighlighted)
    def _highlighted(self, event: OptionList.OptionHighlighted) -> None:
        self._show(self._places[event.option_index])

    @on(OptionList.OptionSelected)
    def _to_page(self) -> None:
        self.query_one("#manual-page").focus()

    @on(Markdown.LinkClicked)
    def _follow(self, event: Markdown.LinkClicked) -> None:
        """Go to the page and the heading of a link, or open a web address in the browser."""
        event.stop()
        file, _, anchor = event.href.partition("#")
        if "://" in file:
            self.app.open_url(event.href)
            return
        try:
            page = self._manual.find(file) if file else self._wanted.page
        except ValueError as error:
            self.notify(str(error), title="Manual", severity="error", markup=False)
            return
        self._show(PagePosition(page, page.heading_of(anchor)))

    def action_search(self) -> None:
        """Focus the search field."""
        self.query_one("#manual-search").focus()

    def _list_pages(self) -> None:
        pages = self._manual.pages
        self._places = [PagePosition(page) for page in pages]
        at = next((number for number, page in enumerate(pages) if page == self._wanted.page), 0)
        self._list([Content(f" {page.title}") for page in pages], at)
        self._title(f"{len(pages)} pages; / finds words in all of them")

    def _list(self, lines: list[Content], at: int = 0) -> None:
        listing = self.query_one("#manual-list", OptionList)
        listing.clear_options()
        listing.add_options(Option(line) for line in lines)
        if lines:
            listing.highlighted = at

    def _title(self, note: str) -> None:
        text = Content.assemble(("Manual  ", f"bold {NOTE}"), (note, QUIET))
        self.query_one("#manual-title", Static).update(text)

    def _show(self, place: PagePosition) -> None:
        """Show a place; if several are requested during a layout, only the last one is shown."""
        self._wanted = place
        if not self._busy:
            self._busy = True
            self.run_worker(self._lay_out(), group="manual")

    async def _lay_out(self) -> None:
        text = self.query_one("#manual-text", Markdown)
        while self._shown != self._wanted:
            place = self._wanted
            if self._shown is None or self._shown.page != place.page:
                await text.update(place.page.text)
            self._shown = place
            self.call_after_refresh(self._scroll, text, place.heading)
        self._busy = False

    def _scroll(self, text: Markdown, heading: int) -> None:
        """Scroll the heading with this number to the top, as far as possible, and mark it."""
        headings = text.table_of_contents
        text.query(f".{FOUND}").remove_class(FOUND)
        if 0 < heading < len(headings):
            target = text.query_one(f"#{headings[heading][2]}")
            target.add_class(FOUND)
            target.scroll_visible(top=True, animate=False)
        else:
            self.query_one("#manual-page", VerticalScroll).scroll_home(animate=False)


def help_rows(
    now: ActionContext, keymap: Mapping[str, str] | None = None, here: Sequence[Binding] = ()
) -> list[WrappedRow]:
    """Return the help page with the user's keys, and the reason if an action is not legal now.

    The keys of the open screen, `here`, come first.
    """
    rows: list[WrappedRow] = []
    if here:
        rows.append(row("", ("On this screen", f"bold {NOTE}")))
        rows += [
            row(["  ", column(key_text(binding.key), 10, "bold")], binding.description)
            for binding in here
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
    """The help page; Escape, F1, q or ? closes it, and M opens the manual."""

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
        """Set the title of the page, and let the arrow keys scroll it."""
        page = self.query_one("#help", VerticalScroll)
        page.border_title = "Help"
        page.border_subtitle = "M opens the manual, Esc closes"
        page.focus()
