"""The user's settings file, changed one field at a time, atomically, with its comments kept."""

from pathlib import Path
from typing import cast

import yaml

from pa_console.private_files import make_private_folder, mode_of, replace_private
from pa_console.schema.document import Document, DocumentError, read_text

HEAD = "# Settings of PA Console; `pa-console settings show` lists them all.\n"


def save_setting(path: Path, name: str, value: object) -> None:
    """Write `name: value` into the file at `path`, a new one if needed; None removes the field.

    The rest of the file stays as it was written. Raises DocumentError if the file is not YAML,
    OSError if it cannot be written.
    """
    path = path.resolve()  # a link to the file stays one
    text = read_text(path) if path.exists() else HEAD
    write_atomically(path, changed_text(str(path), text, name, value))


def changed_text(source: str, text: str, name: str, value: object) -> str:
    """Return the settings file `text` with `name: value`, or without the field if it is None.

    Raises DocumentError, with `source` as the name of the file, if `text` is not such a file or
    would not be one with that value.
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
    Document(source, whole)  # a file that cannot be read back is not written
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
    """Return the end of a node's content; the end mark of a block is after later comments."""
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
    """Write `text` to `path` so that a reader sees the old file or the new one; raise OSError."""
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
