"""Files for their owner alone: 0600 in folders of 0700 from the start, never through a link."""

import errno
import os
import stat
from contextlib import suppress
from pathlib import Path

FILE_MODE, FOLDER_MODE = 0o600, 0o700
_ALWAYS = os.O_NOFOLLOW | os.O_CLOEXEC | os.O_NONBLOCK
"""A pipe in the place of a file keeps nobody waiting."""


class NotPrivateError(OSError):
    """A file that others may read or write, or that is somebody else's, worded with a remedy."""

    def __init__(self, path: Path, problem: str, code: int = errno.EACCES) -> None:
        super().__init__(code, problem, str(path))


def make_private_folder(folder: Path) -> None:
    """Make `folder` and those above it that are not there, for their owner alone; raises OSError.

    A folder that is there stays as it is.
    """
    for path in reversed((folder, *folder.parents)):
        if not path.is_dir():
            path.mkdir(mode=FOLDER_MODE, exist_ok=True)


def open_private(path: Path, flags: int) -> int:
    """Open `path`, made with mode 0600 if `flags` say so, and return its number.

    A file of one's own that others may use is taken back from them. Raises OSError, and
    NotPrivateError for a link, for what is no plain file, and for one of another owner.
    """
    file = _open(path, flags)
    try:
        found = _own(path, file)
        if stat.S_IMODE(found.st_mode) & 0o077:
            with suppress(PermissionError):  # a disk that knows no owners
                os.fchmod(file, FILE_MODE)
    except BaseException:
        os.close(file)
        raise
    return file


def replace_private(path: Path, content: bytes) -> None:
    """Put `content` safely in the place of `path`, wholly or not at all; raises OSError."""
    new = path.with_name(path.name + ".new")
    new.unlink(missing_ok=True)
    file = _open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL)
    try:
        rest = memoryview(content)
        while rest:
            rest = rest[os.write(file, rest) :]
        os.fsync(file)
    finally:
        os.close(file)
    os.replace(new, path)


def read_private(path: Path, loose: int = 0o077) -> bytes:
    """Return what is in `path`; raises OSError.

    NotPrivateError for a link, a file of another owner, and one that gives others a right of
    those in `loose`: whoever else had it may have used it.
    """
    file = _open(path, os.O_RDONLY)
    with os.fdopen(file, "rb") as stream:
        mode = stat.S_IMODE(_own(path, file).st_mode)
        if mode & loose:
            may = "read" if mode & loose & 0o044 else "change"
            problem = f"others may {may} it (mode {mode:04o}); if nobody did: chmod 600 '{path}'"
            raise NotPrivateError(path, problem)
        return stream.read()


def loose(folder: Path) -> int:
    """Return the mode of `folder` when others have a right to it; 0 when not, or without one."""
    try:
        mode = stat.S_IMODE(folder.stat().st_mode)
    except FileNotFoundError:
        return 0
    return mode if mode & 0o077 else 0


def sync_folder(folder: Path) -> None:
    """Make the names in `folder` safe; raises OSError."""
    file = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(file)
    finally:
        os.close(file)


def _open(path: Path, flags: int) -> int:
    try:
        return os.open(path, flags | _ALWAYS, FILE_MODE)
    except OSError as error:
        if error.errno == errno.ELOOP and path.is_symlink():
            problem = "it is a symbolic link, which is not followed; name the file itself"
            raise NotPrivateError(path, problem, errno.ELOOP) from error
        raise


def _own(path: Path, file: int) -> os.stat_result:
    found = os.fstat(file)
    if not stat.S_ISREG(found.st_mode):
        raise NotPrivateError(path, "it is not a plain file; name another one")
    if found.st_uid != os.geteuid():
        problem = f"it belongs to another user (uid {found.st_uid}); use a file of your own"
        raise NotPrivateError(path, problem)
    return found
