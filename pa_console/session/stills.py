"""The camera stills beside a log, in the folder `LOG.stills`, each named by its SHA-256.

What an operator has been shown is kept so, and the log has the hash: a file that was changed since
is not shown again.
"""

import hashlib
from pathlib import Path

from pa_console.private_files import make_private_folder, replace_private
from pa_console.schema.events.event import CameraStill

MOST_BYTES = 4_000_000
"""A larger file is none that was kept here."""


def stills_folder(log: Path) -> Path:
    """Return the folder of the stills of `log`."""
    return log.with_name(f"{log.name}.stills")


def keep_still(log: Path, content: bytes, still: CameraStill) -> None:
    """Write the file of `still` beside `log`, once; raises OSError."""
    path = stills_folder(log) / still.file_name
    if not path.exists():
        make_private_folder(path.parent)
        replace_private(path, content)


def is_changed(log: Path, still: CameraStill) -> bool | None:
    """Return whether the file of `still` is another than was shown; None if it is not there."""
    path = stills_folder(log) / still.file_name
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest() != still.sha256
    except OSError:
        return None


def read_still(log: Path | None, still: CameraStill) -> bytes | None:
    """Return the file of `still`; None if it is not there as it was when it was shown."""
    if log is None or still.sha256 is None:
        return None
    try:
        with (stills_folder(log) / still.file_name).open("rb") as file:
            content = file.read(MOST_BYTES)
    except OSError:
        return None
    return content if hashlib.sha256(content).hexdigest() == still.sha256 else None
