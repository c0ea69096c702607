"""The camera stills beside a log, in the folder `LOG.stills`, each named by its SHA-256.

An image that was shown to an operator is kept, and its hash is in the log. A file that was changed
afterwards is not shown again.
"""

import hashlib
from pathlib import Path

from pa_console.private_files import make_private_folder, replace_private
from pa_console.schema.events.event import CameraStill

MOST_BYTES = 4_000_000
"""The size limit of a still, in bytes; a larger file was not written by the console."""


def stills_folder(log: Path) -> Path:
    """Return the folder of the stills of `log`."""
    return log.with_name(f"{log.name}.stills")


def keep_still(log: Path, content: bytes, still: CameraStill) -> None:
    """Write the file of `still` beside `log`, unless it exists; raises OSError."""
    path = stills_folder(log) / still.file_name
    if not path.exists():
        make_private_folder(path.parent)
        replace_private(path, content)


def is_changed(log: Path, still: CameraStill) -> bool | None:
    """Return whether the file of `still` was changed after it was shown; None if it is missing."""
    path = stills_folder(log) / still.file_name
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest() != still.sha256
    except OSError:
        return None


def read_still(log: Path | None, still: CameraStill) -> bytes | None:
    """Return the file of `still`; None if it is missing or was changed after it was shown."""
    if log is None or still.sha256 is None:
        return None
    try:
        with (stills_folder(log) / still.file_name).open("rb") as file:
            content = file.read(MOST_BYTES)
    except OSError:
        return None
    return content if hashlib.sha256(content).hexdigest() == still.sha256 else None
