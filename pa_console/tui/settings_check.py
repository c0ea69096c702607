"""What only the running console can tell of a choice: that a model, a world or a key exists."""

from collections.abc import Iterable, Mapping

from textual.theme import BUILTIN_THEMES

from pa_console.llm.catalog import Catalog
from pa_console.llm.errors import ModelError
from pa_console.resources import data_folder, find_data
from pa_console.schema.document import FieldPath
from pa_console.settings.schema import Settings
from pa_console.tui.keymap import KeymapError, check_keys
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
    return "" if found else f"there is no {name} {value!r}; known: {', '.join(known_values(name))}"
