"""The settings from command line, environment, file and defaults, each with its origin.

A change of the file is atomic, concerns one field, and keeps the comments.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Literal, cast

import yaml
from platformdirs import user_config_path
from pydantic import ValidationError

from pa_console.private_files import make_private_folder, mode_of, replace_private
from pa_console.schema.document import Document, DocumentError, FieldPath, read_text
from pa_console.settings.schema import ENV_PREFIX, Settings, describe_settings, value_text

FILE_VARIABLE = f"{ENV_PREFIX}SETTINGS"
PATHS = ("logs", "cache", "signing_key")
SECRET_VARIABLES = (
    f"{ENV_PREFIX}PASSPHRASE",
    f"{ENV_PREFIX}SERVER_KEY",
    f"{ENV_PREFIX}JUDGE_SERVER_KEY",
    f"{ENV_PREFIX}READER_SERVER_KEY",
    f"{ENV_PREFIX}TAK_PASSWORD",
    f"{ENV_PREFIX}AGENT_TOKEN",
    f"{ENV_PREFIX}ALERT",
    f"{ENV_PREFIX}ALERT_LATER",
)
"""The variables with secrets. They are not settings, and never in the settings file."""
EXPORTED = ("cache", "signing_key")
"""The settings that lower layers and child processes read from the environment."""
HEAD = "# Settings of PA Console; `pa-console settings show` lists them all.\n"
"""The first line of a new settings file."""

SettingSource = Literal["command line", "environment", "file", "default"]


@dataclass(frozen=True)
class SettingOrigin:
    """The origin of a value; `place` is an option, a variable, or a file with its line."""

    source: SettingSource
    place: str = ""


def settings_file() -> Path:
    """Return the path of the user's settings file; PA_CONSOLE_SETTINGS overrides it."""
    given = os.environ.get(FILE_VARIABLE)
    return Path(given).expanduser() if given else user_config_path("pa-console") / "settings.yaml"


@dataclass(frozen=True)
class LoadedSettings:
    """The settings in force, with their sources.

    The values in `given` are from the command line: those named in `options` from the verb's
    options, and all others from `--set`.
    """

    path: Path
    given: Mapping[str, object]
    environment: Mapping[str, object]
    document: Document | None
    values: Settings
    options: frozenset[str] = frozenset()

    @property
    def written(self) -> dict[str, object]:
        """The values of the file."""
        return _mapping(self.document)

    def origin(self, name: str) -> SettingOrigin:
        """Return the origin of the value of the field `name`."""
        if name in self.given:
            return SettingOrigin(
                "command line", f"--{'' if name in self.options else 'set '}{name}"
            )
        if name in self.environment:
            return SettingOrigin("environment", f"{ENV_PREFIX}{name.upper()}")
        if self.document is not None and name in self.written:
            return SettingOrigin("file", f"{self.path}:{self.document.line((name,))}")
        return SettingOrigin("default")

    def error(self, field: FieldPath, problem: str) -> DocumentError:
        """Return an error about `field` that names `problem` and the origin of the value."""
        origin = self.origin(str(field[0])) if field else SettingOrigin("file")
        if origin.source in ("command line", "environment"):
            rest = ".".join(map(str, field[1:]))
            return DocumentError(origin.place, 0, rest, problem)
        if self.document is None:
            return DocumentError(str(self.path), 0, ".".join(map(str, field)), problem)
        return self.document.error(field, problem)

    def export(self) -> None:
        """Set the environment variables that this process and its children read."""
        for name in EXPORTED:
            value: Path | None = getattr(self.values, name)
            if value is not None:
                os.environ[f"{ENV_PREFIX}{name.upper()}"] = str(value)
        if FILE_VARIABLE in os.environ:
            os.environ[FILE_VARIABLE] = str(self.path.absolute())

    def with_options(self, given: Mapping[str, object]) -> "LoadedSettings":
        """Return the settings, overridden by `given`, the values of a verb's own options."""
        options = self.options | given.keys()
        return _merged(replace(self, given={**self.given, **given}, options=options))

    def again(self) -> "LoadedSettings":
        """Return the settings with the file read again and the other sources unchanged."""
        return _merged(replace(self, document=_read(self.path)))


def load_settings(given: Mapping[str, object] | None = None) -> LoadedSettings:
    """Return the settings from `given` (the command line), environment, user's file and defaults.

    Raises DocumentError if a value is not valid; it names the file and line, variable or option.
    """
    path = settings_file()
    return _merged(LoadedSettings(path, given or {}, _environment(), _read(path), Settings()))


def default_settings() -> LoadedSettings:
    """Return the defaults alone, for use if the user's file is not valid."""
    return LoadedSettings(settings_file(), {}, {}, None, Settings())


def unknown_variables() -> list[str]:
    """Return the unknown PA_CONSOLE_... variables in the environment."""
    variables = {f"{ENV_PREFIX}{name.upper()}" for name in Settings.model_fields}
    variables |= {FILE_VARIABLE, *SECRET_VARIABLES}
    return sorted(
        name for name in os.environ if name.startswith(ENV_PREFIX) and name not in variables
    )


def _read(path: Path) -> Document | None:
    return Document.read(path) if path.exists() else None


def _mapping(document: Document | None) -> dict[str, object]:
    value: object = document.value if document is not None else None
    return {str(k): v for k, v in cast(dict[object, object], value or {}).items()}


def _environment() -> dict[str, object]:
    """Return the values of the PA_CONSOLE_... variables, whose names may be in any case.

    Empty variables are ignored. Raises DocumentError if the setting `keys` is not JSON.
    """
    given = {name.upper(): text for name, text in os.environ.items() if text}
    named = {name: given.get(f"{ENV_PREFIX}{name.upper()}") for name in Settings.model_fields}
    values: dict[str, object] = {name: text for name, text in named.items() if text is not None}
    if "keys" in values:
        try:
            values["keys"] = json.loads(str(values["keys"]))
        except ValueError as error:
            problem = """not JSON; write it like {"stop": "f11"}"""
            raise DocumentError(f"{ENV_PREFIX}KEYS", 0, "", problem) from error
    for name in PATHS:
        if name in values:
            values[name] = str(Path(str(values[name])).expanduser().absolute())
    return values


def _merged(loaded: LoadedSettings) -> LoadedSettings:
    """Return the settings with the validated values of all sources.

    The command line has precedence over the environment, and the environment over the file. Raises
    DocumentError if a value is not valid.
    """
    document = loaded.document
    if document is not None and not isinstance(document.value, dict | None):
        raise document.error((), "expected lines like `theme: pa-console-light`")
    layers = loaded.written | dict(loaded.environment) | dict(loaded.given)
    try:
        return replace(loaded, values=Settings(**layers))  # pyright: ignore[reportArgumentType]
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise loaded.error(
            first["loc"], _worded(first["loc"], first["msg"], first["type"])
        ) from None


def _worded(field: FieldPath, problem: str, kind: str) -> str:
    """Return the problem with `field` and a remedy, in words."""
    about = describe_settings()
    name = str(field[0]) if field else ""
    if kind == "extra_forbidden":
        near = get_close_matches(name, about, 1)
        hint = f"did you mean {near[0]}? The" if near else "the"
        return f"unknown setting; {hint} settings are: {', '.join(about)}"
    setting = about[name]
    if kind == "dict_type":
        problem = "expected names with values"
    remedy = f"give {setting.limits}" if setting.limits else "correct it"
    default = value_text(setting.default)
    return f"{problem_text(problem)}; {remedy}, or omit it for the default" + (
        f" ({default})" if default and name != "keys" else ""
    )


def problem_text(message: str) -> str:
    """Return a validator's message without the words that pydantic puts before it."""
    return message.removeprefix("Value error, ").removeprefix("Assertion failed, ")


def save_setting(path: Path, name: str, value: object) -> None:
    """Write `name: value` into the file at `path`, or remove the field if `value` is None.

    The file is made if it does not exist. The rest of the file remains unchanged. Raises
    DocumentError if the file is not YAML, and OSError if it cannot be written.
    """
    path = path.resolve()  # a symbolic link to the file is kept
    text = read_text(path) if path.exists() else HEAD
    write_atomically(path, changed_text(str(path), text, name, value))


def changed_text(source: str, text: str, name: str, value: object) -> str:
    """Return the settings file `text` with `name: value`, or without the field if `value` is None.

    Raises DocumentError, with `source` as the name of the file, if `text` or the result is not a
    valid settings file.
    """
    document = Document(source, text)
    if not isinstance(document.value, dict | None):
        raise document.error((), "expected lines like `theme: pa-console-light`")
    wanted = {**cast(dict[str, object], document.value or {}), name: value}
    if value is None:
        del wanted[name]
    changed = _edited(document, text, name, value)
    if _has_content(changed, wanted):
        return changed
    whole = HEAD + (yaml.safe_dump(wanted, sort_keys=False) if wanted else "")
    Document(source, whole)  # raises DocumentError rather than write a file that cannot be read
    return whole


def _edited(document: Document, text: str, name: str, value: object) -> str:
    """Return `text` with the lines of the top-level field `name` replaced, added or removed."""
    line = "" if value is None else yaml.safe_dump({name: value}, sort_keys=False)
    root = document.root
    if isinstance(root, yaml.MappingNode):
        for key, below in root.value:
            if key.value == name:
                start, end = key.start_mark.index, _end(below)
                if line:
                    return text[:start] + line.removesuffix("\n") + text[end:]
                _, newline, rest = text[end:].partition("\n")
                return text[:start] + (rest if newline else "")
    return text + ("" if text.endswith("\n") or not text else "\n") + line


def _end(node: yaml.Node) -> int:
    """Return the index at which a node's content ends; a block's end mark includes comments."""
    if isinstance(node, yaml.CollectionNode) and node.value and not node.flow_style:
        last = node.value[-1]
        return _end(cast(yaml.Node, last[1] if isinstance(last, tuple) else last))
    return node.end_mark.index


def _has_content(text: str, wanted: dict[str, object]) -> bool:
    try:
        return (Document("", text).value or {}) == wanted
    except DocumentError:
        return False


def write_atomically(path: Path, text: str) -> None:
    """Write `text` to `path` in one step, so that readers see the old or the new file.

    Raises OSError.
    """
    make_private_folder(path.parent)
    replace_private(path, text.encode(), mode_of(path))


def reset_settings(path: Path) -> Path | None:
    """Rename the file at `path` and return its new path; None if there is no file.

    An older backup is never overwritten. Raises OSError.
    """
    if not path.exists():
        return None
    number = 1
    while (backup := path.with_name(f"{path.name}.bak{f'-{number}' * (number > 1)}")).exists():
        number += 1
    path.rename(backup)
    return backup
