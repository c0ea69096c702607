"""The settings: every choice with its help, checked while it is typed, saved at once."""

from collections.abc import Callable
from itertools import groupby
from typing import cast

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, VerticalScroll
from textual.content import Content
from textual.screen import Screen
from textual.suggester import SuggestFromList
from textual.widgets import Input, OptionList, Select, Static
from textual.widgets.option_list import Option

from pa_console.schema.document import DocumentError
from pa_console.settings.sources import LoadedSettings, save_setting
from pa_console.tui.rows import WrappedRow, column, row
from pa_console.tui.settings_rows import SettingChoice, choices, is_chosen, to_write, value_of
from pa_console.tui.status_words import NOTE, QUIET
from pa_console.tui.widgets.bars import KeyFooter
from pa_console.tui.widgets.fields import LineField
from pa_console.tui.widgets.row_views import TextRows

HINT = "Enter changes it, Del goes back to the default"


class SettingsScreen(Screen[None]):
    """The choices on the left, the one at the pointer with its help and its field on the right."""

    BINDINGS = [Binding("escape", "leave", "Back"), Binding("delete", "restore", "Default")]

    HORIZONTAL_BREAKPOINTS = [(0, "-narrow"), (100, "-wide")]

    def __init__(self, loaded: LoadedSettings, saved: Callable[[LoadedSettings], None]) -> None:
        """Call `saved` with the settings in force after each one that was saved."""
        super().__init__()
        self._loaded, self._tell_saved = loaded, saved
        self._choices = {choice.id: choice for choice in choices()}
        self._at = next(iter(self._choices.values()))

    def compose(self) -> ComposeResult:
        """Yield the list, the detail with its field, and the keys."""
        yield Static(id="setting-title", markup=False)
        with Horizontal(id="setting-body"):
            yield OptionList(id="setting-list", markup=False)
            with VerticalScroll(id="setting-detail", can_focus=False):
                yield TextRows(id="setting-help")
                yield LineField(id="setting-value")
                yield Select[str]((), prompt="the default", compact=True, id="setting-option")
                yield Static(id="setting-note", markup=False)
        yield KeyFooter()

    def on_mount(self) -> None:
        """List everything, the pointer on the first."""
        listing = self.query_one("#setting-list", OptionList)
        for group, rows in groupby(self._choices.values(), key=lambda choice: choice.group):
            listing.add_option(Option(Content.styled(group, f"bold {NOTE}"), disabled=True))
            listing.add_options(Option(self._line(choice), id=choice.id) for choice in rows)
        listing.highlighted = 1
        listing.focus()
        self._head()

    @property
    def _options(self) -> Select[str]:
        return cast(Select[str], self.query_one("#setting-option", Select))

    def _head(self) -> None:
        changed = sum(is_chosen(self._loaded, choice) for choice in self._choices.values())
        text = Content.assemble(
            ("Settings  ", "bold $text-primary"),
            (f"{changed} of {len(self._choices)} chosen, kept in {self._loaded.path}", QUIET),
        )
        self.query_one("#setting-title", Static).update(text)

    def _line(self, choice: SettingChoice) -> Content:
        value, chosen = value_of(self._loaded, choice), is_chosen(self._loaded, choice)
        source = self._loaded.origin(str(choice.field[0])).source if chosen else ""
        return Content.assemble(
            column(f"  {choice.title}", 28),
            column(value or "the default", 20, "bold" if chosen else QUIET),
            (source, QUIET),
        )

    @on(OptionList.OptionHighlighted, "#setting-list")
    def _show(self, event: OptionList.OptionHighlighted) -> None:
        self._at = self._choices[event.option.id or ""]
        self._fill(HINT)

    def _fill(self, note: str, style: str = QUIET) -> None:
        """Show the choice at the pointer with the value in force, and `note` below it."""
        choice, loaded = self._at, self._loaded
        self.query_one("#setting-help", TextRows).show(tuple(_help(loaded, choice)))
        field = self.query_one("#setting-value", Input)
        options = self._options
        field.display, options.display = not choice.options, bool(choice.options)
        value = value_of(loaded, choice)
        with self.prevent(Input.Changed, Select.Changed):
            if choice.options:
                options.set_options((name, name) for name in choice.options)
                options.value = value if value in choice.options else Select.NULL
            else:
                field.suggester = SuggestFromList(choice.known, case_sensitive=False)
                field.placeholder = choice.default or "empty: the default"
                field.value = value
        self._note(note, style)

    def _note(self, text: str, style: str) -> None:
        self.query_one("#setting-note", Static).update(Content.styled(text, style))

    @on(Input.Changed, "#setting-value")
    def _check(self, event: Input.Changed) -> None:
        try:
            to_write(self._loaded, self._at, event.value)
        except ValueError as error:
            self._note(f"✘ {error}", "$text-error")
        else:
            what = "saves it" if event.value.strip() else "goes back to the default"
            self._note(f"✔ Enter {what}, Esc leaves it as it was", "$text-success")

    @on(Input.Submitted, "#setting-value")
    def _typed(self, event: Input.Submitted) -> None:
        event.stop()
        self._save(event.value)

    @on(Select.Changed, "#setting-option")
    def _chosen(self, event: Select.Changed) -> None:
        value: object = event.value
        if not isinstance(value, str):
            self._save("")
        elif value != value_of(self._loaded, self._at):
            self._save(value)

    def _save(self, text: str) -> None:
        """Write the choice at the pointer; an invalid one is shown and not written."""
        choice = self._at
        try:
            self._loaded = self._loaded.again()
            name, value = to_write(self._loaded, choice, text)
            save_setting(self._loaded.path, name, value)
            self._loaded = self._loaded.again()
        except (ValueError, DocumentError) as error:
            self._note(f"✘ not saved: {error}", "$text-error")
            return
        except OSError as error:
            self._note(f"✘ not saved: {error.filename}: {error.strerror}", "$text-error")
            return
        listing = self.query_one("#setting-list", OptionList)
        for row_id, known in self._choices.items():
            listing.replace_option_prompt(row_id, self._line(known))
        self._head()
        listing.focus()
        when = "used from the next start" if choice.restart else "in force now"
        origin = self._loaded.origin(name)
        if origin.source in ("command line", "environment"):
            when = f"but {origin.place} wins over it"
        done = "saved" if text.strip() else "back to the default"
        self._fill(f"✔ {done}, {when}", "$text-success")
        self._tell_saved(self._loaded)

    def on_option_list_option_selected(self) -> None:
        """Go to the field of the choice at the pointer."""
        if self._at.options:
            options = self._options
            options.focus()
            options.action_show_overlay()
        else:
            self.query_one("#setting-value", Input).focus()
            self._note("Enter saves it, Esc leaves it as it was", QUIET)

    def action_restore(self) -> None:
        """Take the choice at the pointer out of the file."""
        if self.query_one("#setting-list").has_focus:
            self._save("")

    def action_leave(self) -> None:
        """Leave the field without saving, or the screen."""
        listing = self.query_one("#setting-list", OptionList)
        if listing.has_focus:
            self.dismiss()
        else:
            self._fill(HINT)
            listing.focus()


def _help(loaded: LoadedSettings, choice: SettingChoice) -> list[WrappedRow]:
    """Return what there is to know of a choice."""
    rows = [row("", (choice.title, "bold"), (f"  {choice.id}", QUIET)), row("", choice.help)]
    if choice.limits:
        rows.append(row(column("give", 8, QUIET), choice.limits))
    if choice.known:
        rows.append(row(column("known", 8, QUIET), ", ".join(choice.known)))
    if choice.default:
        rows.append(row(column("default", 8, QUIET), choice.default))
    if is_chosen(loaded, choice):
        origin = loaded.origin(str(choice.field[0]))
        rows.append(row(column("from", 8, QUIET), f"{origin.source}: {origin.place}"))
    if choice.restart:
        rows.append(row(column("used", 8, QUIET), "from the next start"))
    return rows
