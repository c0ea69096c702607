"""Where fetched models are kept on this machine, and the hash of a file there."""

import hashlib
import os
from pathlib import Path

from platformdirs import user_cache_path

CACHE_VARIABLE = "PA_CONSOLE_CACHE"


def cache_folder() -> Path:
    """Return the folder for everything that can be fetched again; PA_CONSOLE_CACHE overrides it."""
    given = os.environ.get(CACHE_VARIABLE)
    return Path(given).expanduser() if given else user_cache_path("pa-console")


def models_folder() -> Path:
    """Return the folder of complete, checked model files."""
    return cache_folder() / "models"


def partial_folder(name: str) -> Path:
    """Return the folder of what has been fetched so far of model `name`."""
    return cache_folder() / "partial" / name


def hash_file(path: Path) -> str:
    """Return the SHA-256 of the file at `path`; about 1 s per GB."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
