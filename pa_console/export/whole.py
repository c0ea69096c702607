"""Writes a file or a folder wholly or not at all: it takes its name once it is complete."""

import os
import shutil
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from pa_console.session.audit_files import refuse_audit_file


@contextmanager
def whole_file(path: Path, log: Path) -> Generator[BinaryIO]:
    """Yield a file that replaces `path` when the block ends well, and vanishes otherwise.

    Raises ValueError when `path` is a folder, the `log` itself or any other file of an audit.
    """
    if path.is_dir():
        raise ValueError(f"{path}: this is a folder; give the name of a file")
    if path.exists() and path.samefile(log):
        raise ValueError(f"{path}: this is the log itself; give another name")
    refuse_audit_file(path)
    part = _beside(path)
    try:
        with part.open("xb") as file:
            yield file
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


@contextmanager
def whole_folder(path: Path) -> Generator[Path]:
    """Yield a folder that gets the name `path` when the block ends well, and vanishes otherwise.

    Raises ValueError when something is there already that is not an empty folder.
    """
    if path.exists() and not (path.is_dir() and not any(path.iterdir())):
        raise ValueError(f"{path}: exists already; name a new or an empty folder")
    part = _beside(path)
    part.mkdir()
    try:
        yield part
        if path.exists():
            path.rmdir()
        part.rename(path)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _beside(path: Path) -> Path:
    """Return a hidden name in the folder of `path`, which no other process uses."""
    if not path.parent.is_dir():
        raise ValueError(f"{path}: the folder {path.parent} does not exist")
    return path.with_name(f".{path.name}.{os.getpid()}.part")
