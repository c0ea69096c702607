"""Whether something could be written where a setting points."""

import os
from pathlib import Path


def nearest_existing(path: Path) -> Path:
    """Return `path`, or the nearest folder above it that exists."""
    while not path.exists() and path != path.parent:
        path = path.parent
    return path


def unwritable(folder: Path) -> str:
    """Return why nothing could be written into `folder`, which may not exist; empty when it can."""
    found = nearest_existing(folder)
    if not found.is_dir():
        return f"{found} is not a folder"
    return "" if os.access(found, os.W_OK | os.X_OK) else f"{found} cannot be written to"
