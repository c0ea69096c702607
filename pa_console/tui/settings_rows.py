"""The rows of the settings screen, made from the schema and from the registry of actions."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

from pydantic import ValidationError

from pa_console.schema.document import FieldPath
from pa_console.settings.folders import unwritable
from pa_console.settings.schema import Settings, describe_settings, value_text
from pa_console.settings.sources import PATHS, Loaded, problem_text
from pa_console.tui.keymap import check_keys, key_names, own_keys
from pa_console.tui.settings_check import known_values, unknown


@dataclass(frozen=True)
class Choice:
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


def choices() -> list[Choice]:
    """Return every row, fields first, in the schema's order."""
    rows: list[Choice] = []
    for name, about in describe_settings().items():
        if name == "keys":
            continue
        known = tuple(known_values(name))
        options = ("on", "off") if about.boolean else known if name == "theme" else ()
        rows.append(
            Choice(
                (name,), about.title, about.help, about.group, about.restart, about.limits,
                value_text(about.default), options, () if options else known,
            )
        )  # fmt: skip
    limits = "key names separated by commas, like f11,ctrl+x"
    for name, action in key_names().items():
        more = " (further keys)" if name.endswith(".also") else ""
        keys = own_keys(action, {})[name]
        title, help_text = f"{action.label}{more}", f"{action.help}."
        rows.append(Choice(("keys", name), title, help_text, "Keys", False, limits, keys))
    return rows


def value_of(loaded: Loaded, choice: Choice) -> str:
    """Return the value in force, as a person types it."""
    if choice.field[0] == "keys":
        return loaded.values.keys.get(str(choice.field[1]), choice.default)
    return value_text(getattr(loaded.values, str(choice.field[0])))


def is_chosen(loaded: Loaded, choice: Choice) -> bool:
    """Return whether the value in force was given anywhere."""
    name = str(choice.field[0])
    if name == "keys":
        return choice.field[1] in loaded.values.keys
    return loaded.origin(name).source != "default"


def to_write(loaded: Loaded, choice: Choice, text: str) -> tuple[str, object]:
    """Return the field of the file, and what has to stand there for `text`; None for nothing.

    Raises ValueError that says what is wrong with `text`.
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
