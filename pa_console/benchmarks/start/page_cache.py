"""Takes files out of the system's page cache, so that the next reader has them from the disk."""

import errno
import os
from collections.abc import Iterable
from pathlib import Path

CAN_DROP = hasattr(os, "posix_fadvise") and hasattr(os, "RWF_NOWAIT")


def drop(files: Iterable[Path]) -> bool:
    """Ask the system to forget `files`; False where one is still there afterwards.

    That needs no rights. The system keeps what another process has mapped, and what is not yet on
    the disk. Raises OSError for a file that cannot be read.
    """
    return CAN_DROP and not [file for file in files if not _drop(file)]


def _drop(file: Path) -> bool:
    descriptor = os.open(file, os.O_RDONLY)
    try:
        os.posix_fadvise(descriptor, 0, 0, os.POSIX_FADV_DONTNEED)
        return not _cached(descriptor)
    finally:
        os.close(descriptor)


def _cached(descriptor: int) -> bool:
    """Return whether the middle of a file can be read without waiting for the disk."""
    middle = os.fstat(descriptor).st_size // 2
    try:
        return bool(os.preadv(descriptor, [bytearray(1)], middle, os.RWF_NOWAIT))
    except OSError as error:
        if error.errno == errno.EAGAIN:
            return False
        raise
