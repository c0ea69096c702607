"""The settings screen: every choice with its help, checked while it is typed, saved at once.

The command line uses the same functions to check whether a value can be used.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import groupby
from typing import cast

from pydantic import ValidationError
from textual import on
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, VerticalScroll
from textual.content import Content
from textual.screen import Screen
from textual.suggester import SuggestFromList
from textual.theme import BUILTIN_THEMES
from textual.widgets import Input, OptionList, Select, Static
from textual.widgets.option_list import Option

from pa_console.llm.backend import ModelError
from pa_console.llm.models.catalogue import Catalog
from pa_console.private_files import unwritable
from pa_console.resources import data_folder, find_data
from pa_console.schema.document import DocumentError, FieldPath
from pa_console.settings.schema import Settings, describe_settings, value_text
from pa_console.settings.sources import PATHS, LoadedSettings, problem_text, save_setting
from pa_console.tui.actions import KeymapError, check_keys, key_names, own_keys
from pa_console.tui.rows import WrappedRow, column, row
from pa_console.tui.status_words import NOTE, QUIET
from pa_console.tui.theme import THEMES
from pa_console.tui.widgets.bars import KeyFooter
from pa_console.tui.widgets.fields import LineField
from pa_console.tui.widgets.row_views import TextRows

HINT = "Enter changes it, Del restores the default"
_FILES = {"world": ("worlds", "world.yaml"), "rules": ("rules", "rules.yaml")}


def theme_names() -> list[str]:
    """Return all themes, the console's own first."""
    return [*(theme.name for theme in THEMES), *sorted(BUILTIN_THEMES)]


def known_values(name: str) -> list[str]:
    """Return the named values of the field `name`; other values may be valid too."""
    match name:
        case "theme":
            return theme_names()
        case "model":
            return [entry.name for entry in Catalog.load().models]
        case "world" | "rules":
            kind, _ = _FILES[name]
            entries = sorted((data_folder() / kind).iterdir())
            return [path.stem for path in entries if _is_installed(name, path.stem)]
        case _:
            return []


def _is_installed(name: str, value: str) -> bool:
    kind, file = _FILES[name]
    return find_data(kind, value, file).is_file()


def problems(values: Settings) -> Iterable[tuple[FieldPath, str]]:
    """Yield each field of `values` that cannot be used here, with the reason."""
    for name in ("model", "world", "rules", "theme"):
        why = unknown(name, getattr(values, name))
        if why:
            yield (name,), why
    why_keys = key_problem(values.keys)
    if why_keys is not None:
        yield ("keys", why_keys.name), why_keys.problem


def key_problem(keymap: Mapping[str, str]) -> KeymapError | None:
    """Return the error that makes a keymap unusable; None if it can be used."""
    try:
        check_keys(keymap)
    except KeymapError as problem:
        return problem
    return None


def unknown(name: str, value: str) -> str:
    """Return the reason why `value` cannot be used; empty if it can.

    `name` is the field: model, world, rules or theme. Every value of another field is valid.
    """
    if name not in ("model", "world", "rules", "theme"):
        return ""
    if name == "model":
        try:
            Catalog.load().get(value or Catalog.load().default)
        except ModelError as error:
            return str(error)
        return ""
    exists = value in theme_names() if name == "theme" else _is_installed(name, value)
    return "" if exists else f"there is no {name} “{value}”; known: {', '.join(known_values(name))}"


@dataclass(frozen=True)
class SettingChoice:
    """One choice of the screen: a field of the schema, or the keys of one action.

    If there are `options`, only those are possible. Otherwise, a value is typed, and
    `suggestions` has some valid values. An empty `default` is explained in the help.
    """

    field: FieldPath
    title: str
    help: str
    group: str
    restart: bool
    limits: str
    default: str
    options: tuple[str, ...] = ()
    suggestions: tuple[str, ...] = ()

    @property
    def id(self) -> str:
        """The id of the choice's row on the screen."""
        return ".".join(map(str, self.field))


def choices() -> list[SettingChoice]:
    """Return all choices, fields first, in the order of the schema."""
    rows: list[SettingChoice] = []
    for name, about in describe_settings().items():
        if name == "keys":
            continue
        known = tuple(known_values(name))
        options = ("on", "off") if about.boolean else known if name == "theme" else ()
        rows.append(
            SettingChoice(
                (name,), about.title, about.help, about.group, about.restart, about.limits,
                value_text(about.default), options, () if options else known,
            )
        )  # fmt: skip
    limits = "key names separated by commas, like f11,ctrl+x"
    for name, action in key_names().items():
        more = " (further keys)" if name.endswith(".also") else ""
        keys = own_keys(action, {})[name]
        title, help_text = f"{action.label}{more}", f"{action.help}."
        rows.append(SettingChoice(("keys", name), title, help_text, "Keys", False, limits, keys))
    return rows


def value_of(loaded: LoadedSettings, choice: SettingChoice) -> str:
    """Return the value in force, as it is typed in the field."""
    if choice.field[0] == "keys":
        return loaded.values.keys.get(str(choice.field[1]), choice.default)
    return value_text(getattr(loaded.values, str(choice.field[0])))


def is_chosen(loaded: LoadedSettings, choice: SettingChoice) -> bool:
    """Return whether the value in force was set by the user, in any source of settings."""
    name = str(choice.field[0])
    if name == "keys":
        return choice.field[1] in loaded.values.keys
    return loaded.origin(name).source != "default"


def to_write(loaded: LoadedSettings, choice: SettingChoice, text: str) -> tuple[str, object]:
    """Return the field of the file and its value for `text`; a value of None removes the field.

    Raises ValueError for an invalid `text`.
    """
    name, text = str(choice.field[0]), text.strip()
    if name == "keys":
        keys = dict(cast(Mapping[str, str], loaded.written.get("keys") or {}))
        keys.pop(str(choice.field[1]), None)
        if text and text != choice.default:
            keys[str(choice.field[1])] = text
        check_keys(keys)
        return name, keys or None
    if not text:
        return name, None
    try:
        values = Settings.model_validate({name: text})
    except ValidationError as error:
        problem = problem_text(error.errors(include_url=False)[0]["msg"])
        raise ValueError(f"{problem}; give {choice.limits}" if choice.limits else problem) from None
    chosen = getattr(values, name)
    folder = chosen.parent if name == "signing_key" else chosen
    why = unwritable(folder) if name in PATHS else unknown(name, chosen)
    if why:
        raise ValueError(why)
    return name, values.model_dump(mode="json")[name]


class SettingsScreen(Screen[None]):
    """The choices on the left; on the right, the choice at the pointer with its help and field."""

    BINDINGS = [Binding("escape", "leave", "Back"), Binding("delete", "restore", "Default")]

    HORIZONTAL_BREAKPOINTS = [(0, "-narrow"), (100, "-wide")]

    def __init__(self, loaded: LoadedSettings, saved: Callable[[LoadedSettings], None]) -> None:
        """Call `saved` with the settings in force after each setting that is saved."""
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
        """List all choices, with the pointer on the first."""
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
            (f"{changed} of {len(self._choices)} set, saved in {self._loaded.path}", QUIET),
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
                field.suggester = SuggestFromList(choice.suggestions, case_sensitive=False)
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
            effect = "saves it" if event.value.strip() else "restores the default"
            self._note(f"✔ Enter {effect}, Esc leaves it as it was", "$text-success")

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
        """Save the choice at the pointer; if it is invalid, show the problem instead."""
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
        for row_id, choice_of_row in self._choices.items():
            listing.replace_option_prompt(row_id, self._line(choice_of_row))
        self._head()
        listing.focus()
        when = "applies from the next start" if choice.restart else "in force now"
        origin = self._loaded.origin(name)
        if origin.source in ("command line", "environment"):
            when = f"but {origin.place} overrides it"
        done = "saved" if text.strip() else "back to the default"
        self._fill(f"✔ {done}, {when}", "$text-success")
        self._tell_saved(self._loaded)

    def on_option_list_option_selected(self) -> None:
        """Focus the field of the choice at the pointer."""
        if self._at.options:
            options = self._options
            options.focus()
            options.action_show_overlay()
        else:
            self.query_one("#setting-value", Input).focus()
            self._note("Enter saves it, Esc leaves it as it was", QUIET)

    def action_restore(self) -> None:
        """Remove the choice at the pointer from the file."""
        if self.query_one("#setting-list").has_focus:
            self._save("")

    def action_leave(self) -> None:
        """Leave the field without saving, or leave the screen."""
        listing = self.query_one("#setting-list", OptionList)
        if listing.has_focus:
            self.dismiss()
        else:
            self._fill(HINT)
            listing.focus()


def _help(loaded: LoadedSettings, choice: SettingChoice) -> list[WrappedRow]:
    """Return the help for a choice, with its limits, known values, default and origin."""
    rows = [row("", (choice.title, "bold"), (f"  {choice.id}", QUIET)), row("", choice.help)]
    if choice.limits:
        rows.append(row(column("give", 8, QUIET), choice.limits))
    if choice.suggestions:
        rows.append(row(column("known", 8, QUIET), ", ".join(choice.suggestions)))
    if choice.default:
        rows.append(row(column("default", 8, QUIET), choice.default))
    if is_chosen(loaded, choice):
        origin = loaded.origin(str(choice.field[0]))
        rows.append(row(column("from", 8, QUIET), f"{origin.source}: {origin.place}"))
    if choice.restart:
        rows.append(row(column("applies", 8, QUIET), "from the next start"))
    return rows
