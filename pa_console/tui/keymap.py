"""The user's own keys: a YAML file that maps action ids to keys."""

from pathlib import Path
from typing import cast

from pa_console.schema.document import Document, DocumentError
from pa_console.tui.actions import ACTIONS


def keymap_file() -> Path:
    """Return where the user's keys are looked for."""
    from platformdirs import user_config_path  # noqa: PLC0415  (only after the first paint)

    return user_config_path("pa-console") / "keymap.yaml"


def load_keymap(path: Path) -> dict[str, str]:
    """Read `{action id: "key,key"}`; a missing file is an empty map.

    Raises DocumentError for an id that is not in the registry or keys that are not a text.
    """
    if not path.is_file():
        return {}
    document = Document.read(path)
    given: object = document.value
    if not isinstance(given, dict):
        raise DocumentError(str(path), 1, "", "expected lines like `stop: f9,S`")
    known = {binding.id for action in ACTIONS for binding in action.bindings if binding.id}
    result: dict[str, str] = {}
    for name, keys in cast(dict[object, object], given).items():
        if name not in known:
            raise document.error((str(name),), f"unknown action; known: {', '.join(sorted(known))}")
        if not isinstance(keys, str):
            raise document.error((str(name),), "expected key names separated by commas")
        result[str(name)] = keys
    return result
