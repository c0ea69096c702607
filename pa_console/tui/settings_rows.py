"""The rows of the settings screen, with the facts of a choice that only the console knows."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import cast

from pydantic import ValidationError
from textual.theme import BUILTIN_THEMES

from pa_console.llm.backend import ModelError
from pa_console.llm.models.catalogue import Catalog
from pa_console.private_files import unwritable
from pa_console.resources import data_folder, find_data
from pa_console.schema.document import FieldPath
from pa_console.settings.schema import Settings, describe_settings, value_text
from pa_console.settings.sources import PATHS, LoadedSettings, problem_text
from pa_console.tui.actions import KeymapError, check_keys, key_names, own_keys
from pa_console.tui.theme import THEMES

_FILES = {"world": ("worlds", "world.yaml"), "rules": ("rules", "rules.yaml")}


def theme_names() -> list[str]:
    """Return every theme there is, the console's own first."""
    return [*(theme.name for theme in THEMES), *sorted(BUILTIN_THEMES)]


def known_values(name: str) -> list[str]:
    """Return the values of the field `name` that are known by name; others may be good too."""
    match name:
        case "theme":
            return theme_names()
        case "model":
            return [entry.name for entry in Catalog.load().models]
        case "world" | "rules":
            kind, _ = _FILES[name]
            found = sorted((data_folder() / kind).iterdir())
            return [path.stem for path in found if _is_installed(name, path.stem)]
        case _:
            return []


def _is_installed(name: str, value: str) -> bool:
    kind, file = _FILES[name]
    return find_data(kind, value, file).is_file()


def problems(values: Settings) -> Iterable[tuple[FieldPath, str]]:
    """Yield each field of `values` that cannot be used here, and why."""
    for name in ("model", "world", "rules", "theme"):
        why = unknown(name, getattr(values, name))
        if why:
            yield (name,), why
    why_keys = key_problem(values.keys)
    if why_keys is not None:
        yield ("keys", why_keys.name), why_keys.problem


def key_problem(keymap: Mapping[str, str]) -> KeymapError | None:
    """Return what keeps a keymap from being used."""
    try:
        check_keys(keymap)
    except KeymapError as problem:
        return problem
    return None


def unknown(name: str, value: str) -> str:
    """Return why the model, world, rule set or theme `value` cannot be used, empty when it can.

    Every value of another field is good.
    """
    if name not in ("model", "world", "rules", "theme"):
        return ""
    if name == "model":
        try:
            Catalog.load().get(value or Catalog.load().default)
        except ModelError as error:
            return str(error)
        return ""
    found = value in theme_names() if name == "theme" else _is_installed(name, value)
    return "" if found else f"there is no {name} “{value}”; known: {', '.join(known_values(name))}"


@dataclass(frozen=True)
class SettingChoice:
    """One thing to choose: a field of the schema, or the keys of one action.

    `options` are the only values there are; where it is empty a value is typed, and `known` are
    some that are good. An empty `default` is explained in the help.
    """

    field: FieldPath
    title: str
    help: str
    group: str
    restart: bool
    limits: str
    default: str
    options: tuple[str, ...] = ()
    known: tuple[str, ...] = ()

    @property
    def id(self) -> str:
        """The name by which the screen knows the row."""
        return ".".join(map(str, self.field))


def choices() -> list[SettingChoice]:
    """Return every row, fields first, in the schema's order."""
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
    """Return the value in force, as a person types it."""
    if choice.field[0] == "keys":
        return loaded.values.keys.get(str(choice.field[1]), choice.default)
    return value_text(getattr(loaded.values, str(choice.field[0])))


def is_chosen(loaded: LoadedSettings, choice: SettingChoice) -> bool:
    """Return whether the value in force was given anywhere."""
    name = str(choice.field[0])
    if name == "keys":
        return choice.field[1] in loaded.values.keys
    return loaded.origin(name).source != "default"


def to_write(loaded: LoadedSettings, choice: SettingChoice, text: str) -> tuple[str, object]:
    """Return the field of the file and its value for `text`; None removes it.

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
