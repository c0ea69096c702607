"""Files and folders that only their owner can use (modes 0600 and 0700), and checks of folders."""

import errno
import os
import stat
import tempfile
from contextlib import suppress
from pathlib import Path

FILE_MODE, FOLDER_MODE = 0o600, 0o700
# O_NONBLOCK: opening a pipe in the place of the file must not wait for its other end.
_ALWAYS = os.O_NOFOLLOW | os.O_CLOEXEC | os.O_NONBLOCK


class NotPrivateError(OSError):
    """An error for a file that belongs to another user, or that others may use, with a remedy."""

    def __init__(self, path: Path, problem: str, code: int = errno.EACCES) -> None:
        super().__init__(code, problem, str(path))


def make_private_folder(folder: Path) -> None:
    """Make `folder` and its missing parents accessible only to their owner; raises OSError.

    An existing folder is not changed.
    """
    for path in reversed((folder, *folder.parents)):
        if not path.is_dir():
            path.mkdir(mode=FOLDER_MODE, exist_ok=True)


def open_private(path: Path, flags: int) -> int:
    """Open `path` and return its descriptor; a new file has mode 0600.

    If the file belongs to this user, the rights of other users are removed. Raises OSError, and
    NotPrivateError for a link, for anything but a plain file, and for a file of another owner.
    """
    file = _open(path, flags)
    try:
        status = _own(path, file)
        if stat.S_IMODE(status.st_mode) & 0o077:
            with suppress(PermissionError):  # a file system without owners
                os.fchmod(file, FILE_MODE)
    except BaseException:
        os.close(file)
        raise
    return file


def replace_private(path: Path, content: bytes, mode: int = FILE_MODE) -> None:
    """Replace `path` with a file that holds `content`, completely or not at all.

    A reader sees either the old file or the new one, which is then already on the disk. A `mode`
    other than the default can open the file to other users. Raises OSError.
    """
    file, new = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}-")
    try:
        with os.fdopen(file, "wb") as stream:
            os.fchmod(file, mode)
            stream.write(content)
            stream.flush()
            os.fsync(file)
        os.replace(new, path)
    except BaseException:
        with suppress(OSError):
            os.unlink(new)
        raise


def mode_of(path: Path) -> int:
    """Return the mode of `path`, or FILE_MODE if there is no such file; raises OSError."""
    try:
        return stat.S_IMODE(path.stat().st_mode)
    except FileNotFoundError:
        return FILE_MODE


def write_all(file: int, content: bytes) -> None:
    """Write all of `content` to the open `file`; raises OSError."""
    rest = memoryview(content)
    while rest:
        rest = rest[os.write(file, rest) :]


def read_private(path: Path, loose: int = 0o077) -> bytes:
    """Return the content of `path`; raises OSError.

    Raises NotPrivateError for a link and for a file of another owner. It is also raised for a file
    that gives other users a right in `loose`, because they may already have read or changed it.
    """
    file = _open(path, os.O_RDONLY)
    with os.fdopen(file, "rb") as stream:
        mode = stat.S_IMODE(_own(path, file).st_mode)
        if mode & loose:
            may = "read" if mode & loose & 0o044 else "change"
            problem = f"others may {may} it (mode {mode:04o}); if nobody has: chmod 600 '{path}'"
            raise NotPrivateError(path, problem)
        return stream.read()


def exposed(folder: Path, rights: int) -> tuple[str, str] | None:
    """Return how other users can access `folder`, and a remedy; None if they cannot.

    They can access it if they have one of the `rights` to it (0o077: any, 0o022: to write). They
    also can if they are able to replace the folder, the target of a link, or a folder above these.
    """
    if not folder.is_dir():
        return None
    place = folder.resolve()
    named = f"{folder}" if place == folder.absolute() else f"{folder} is a link to {place}"
    mode = stat.S_IMODE(place.stat().st_mode)
    if mode & rights:
        may = "write there" if mode & 0o022 else "look into it"
        return f"{named}: others may {may} (mode {mode:04o})", f"chmod 700 '{place}'"
    for above in (*place.parents, *folder.absolute().parents):
        mode = stat.S_IMODE(above.stat().st_mode)
        if mode & stat.S_IWOTH and not mode & stat.S_ISVTX:
            problem = f"others may put another folder in its place: they may write to {above}"
            return f"{named}: {problem} (mode {mode:04o})", f"chmod o-w '{above}'"
    return None


def nearest_existing(path: Path) -> Path:
    """Return `path`, or the nearest existing folder above it."""
    while not path.exists() and path != path.parent:
        path = path.parent
    return path


def unwritable(folder: Path) -> str:
    """Return why `folder`, which may not exist yet, cannot be written to; '' if it can."""
    place = nearest_existing(folder)
    if not place.is_dir():
        return f"{place} is not a folder"
    return "" if os.access(place, os.W_OK | os.X_OK) else f"{place} cannot be written to"


def sync_folder(folder: Path) -> None:
    """Write the directory entries of `folder` to the disk; raises OSError."""
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
    status = os.fstat(file)
    if not stat.S_ISREG(status.st_mode):
        raise NotPrivateError(path, "it is not a plain file; name another one")
    if status.st_uid != os.geteuid():
        problem = f"it belongs to another user (uid {status.st_uid}); use a file of your own"
        raise NotPrivateError(path, problem)
    return status
