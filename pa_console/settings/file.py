"""Changes the user's settings file: one field at a time, atomically, comments kept."""

import os
import shutil
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import cast

import yaml

from pa_console.private_files import make_private_folder
from pa_console.schema.document import Document, DocumentError, read_text

HEAD = "# Settings of PA Console; `pa-console settings show` tells what there is to choose.\n"


def save_setting(path: Path, name: str, value: object) -> None:
    """Write `name: value` into the file at `path`, made if need be; None takes the field out.

    What else stands in the file stays as it was written. Raises DocumentError when the file cannot
    be read as YAML, OSError when it cannot be written.
    """
    path = path.resolve()  # a link to the file stays one
    text = read_text(path) if path.exists() else HEAD
    write_atomically(path, changed_text(str(path), text, name, value))


def changed_text(source: str, text: str, name: str, value: object) -> str:
    """Return the settings file `text` with `name: value` in it, or without it when that is None.

    `source` names the file in the DocumentError that is raised when `text` is no such file, or
    would be none with that value in it.
    """
    document = Document(source, text)
    if not isinstance(document.value, dict | None):
        raise document.error((), "expected lines like `theme: pa-console-light`")
    wanted = {**cast(dict[str, object], document.value or {}), name: value}
    if value is None:
        del wanted[name]
    changed = _edited(document, text, name, value)
    if _says(changed, wanted):
        return changed
    whole = HEAD + (yaml.safe_dump(wanted, sort_keys=False) if wanted else "")
    Document(source, whole)  # what could not be read again is not written
    return whole


def _edited(document: Document, text: str, name: str, value: object) -> str:
    """Return `text` with the lines of the top-level field `name` replaced, added or taken out."""
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
    """Return where what `node` says ends; a block's own mark lies behind the comments after it."""
    if isinstance(node, yaml.CollectionNode) and node.value and not node.flow_style:
        last = node.value[-1]
        return _end(cast(yaml.Node, last[1] if isinstance(last, tuple) else last))
    return node.end_mark.index


def _says(text: str, wanted: dict[str, object]) -> bool:
    try:
        return (Document("", text).value or {}) == wanted
    except DocumentError:
        return False


def write_atomically(path: Path, text: str) -> None:
    """Write `text` to `path` so that a reader sees the old file or the new one; raises OSError."""
    make_private_folder(path.parent)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}-")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        if path.exists():
            shutil.copymode(path, name)
        os.replace(name, path)
    except BaseException:
        with suppress(OSError):
            os.unlink(name)
        raise


def reset_settings(path: Path) -> Path | None:
    """Move the file at `path` aside and return where it went; None when there was none.

    An older backup is never written over. Raises OSError.
    """
    if not path.exists():
        return None
    number = 1
    while (backup := path.with_name(f"{path.name}.bak{f'-{number}' * (number > 1)}")).exists():
        number += 1
    path.rename(backup)
    return backup
