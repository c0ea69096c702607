"""The files of models on this machine: their folders, and the code that checks and writes them.

A file is loaded exactly as it was checked. If another file replaces the checked one afterwards, it
is never read, because the name is not looked up again. If a program writes into the checked file,
the times of the file change; they are compared before each use. If a write is so recent that the
kernel has not yet recorded it, the next comparison detects it.
"""

import errno
import hashlib
import mmap
import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from platformdirs import user_cache_path

from pa_console.child_processes import OWN_FOLDER, python_command
from pa_console.llm.backend import PullError

DESCRIPTORS = Path("/proc/self/fd")

CACHE_VARIABLE = "PA_CONSOLE_CACHE"
PIECE = 16 << 20
"""The number of bytes hashed at a time. If another thread computes, the hashing thread waits twice
per piece, 5 ms each time, so with pieces of 256 KiB it would hardly advance."""
SLACK = 16_000_000
POLL_S = 0.05
STALL_S = 90.0
STOP_S = 3.0
LAST_WORDS = 64_000
"""The number of bytes at the end of a child's output that are searched for its last line."""

Progress = Callable[[int, int, str], None]
"""A callback that gets the bytes done, the estimated total and the current step; it may raise an
exception to stop the work.
"""


class CheckedFile:
    """An open file with a verified SHA-256; `route` is the path from which it is loaded.

    On Linux, `route` is the path of the open descriptor; on other systems, it is the file's path.
    """

    def __init__(self, path: str, sha256: str) -> None:
        """Open and hash the file, which takes about 1 s per GB; raises ValueError or OSError."""
        self.path, self.sha256 = path, sha256
        self._stream = open(path, "rb", buffering=0)  # noqa: SIM115 - open while it is in use
        own = DESCRIPTORS / str(self._stream.fileno())
        self.route = str(own) if own.exists() else path
        self.size = os.fstat(self._stream.fileno()).st_size
        self._stamp = self._look()
        self._hash()

    def check(self) -> None:
        """Hash the file again if it was written to; raises ValueError if its hash has changed."""
        now = self._look()
        if now != self._stamp:
            self._hash()
            self._stamp = now

    def _look(self) -> tuple[int, int, int]:
        """Return the values that the kernel changes with every write."""
        stat = os.fstat(self._stream.fileno())
        return stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns

    def _hash(self) -> None:
        """Hash the whole file in one step; other threads of this process can run meanwhile.

        Raises ValueError if the hash is not the expected one.
        """
        digest = hashlib.sha256()
        if os.fstat(self._stream.fileno()).st_size:
            with mmap.mmap(self._stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
                digest.update(content)
        actual = digest.hexdigest()
        if actual != self.sha256:
            raise ValueError(
                f"{self.path}: not the file that was checked: its SHA-256 is {actual}, "
                f"but {self.sha256 or 'none'} is expected; start the console again"
            )


def cache_folder() -> Path:
    """Return the folder for files that can be fetched again; PA_CONSOLE_CACHE overrides it."""
    override = os.environ.get(CACHE_VARIABLE)
    return Path(override).expanduser() if override else user_cache_path("pa-console")


def models_folder() -> Path:
    """Return the folder of complete, checked model files."""
    return cache_folder() / "models"


def partial_folder(name: str) -> Path:
    """Return the folder for the fetched parts of model `name`."""
    return cache_folder() / "partial" / name


def hash_file(path: Path) -> str:
    """Return the SHA-256 of the file at `path`.

    This takes about 1 s per GB; other threads can run meanwhile.
    """
    digest, piece = hashlib.sha256(), memoryview(bytearray(PIECE))
    with path.open("rb", buffering=0) as stream:
        while size := stream.readinto(piece):
            digest.update(piece[:size])
    return digest.hexdigest()


def silent(_done: int, _total: int, _text: str) -> None:
    """Report nothing."""


def disk_problem(error: OSError, folder: Path) -> str:
    """Return why a file cannot be written below `folder`, with the remedy for a full disk."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return f"the disk of {folder} is full: free some space, or set {CACHE_VARIABLE}"
    return f"{error.filename or folder}: {error.strerror or error}"


def require_room(folder: Path, needed: int) -> None:
    """Raise PullError unless `needed` bytes are free on the disk of `folder`, which must exist."""
    free = shutil.disk_usage(folder).free
    if free < needed:
        raise PullError(
            f"{needed / 1e6:.0f} MB are needed in {folder}, but {free / 1e6:.0f} MB are free: "
            f"free some space, or set {CACHE_VARIABLE} to a folder on another disk"
        )


def most_bytes(expected: int) -> int:
    """Return the limit on the size of a file that should have about `expected` bytes.

    A larger file must be a different one, so its download is stopped before it is hashed.
    """
    return expected * 11 // 10 + SLACK


def folder_size(folder: Path) -> int:
    """Return the size in bytes of all files under `folder`, which may change during the count."""
    total = 0
    for root, _, names in os.walk(folder):
        for name in names:
            try:
                total += os.lstat(os.path.join(root, name)).st_size
            except FileNotFoundError:
                continue
    return total


def run_watched(
    arguments: Sequence[str],
    *,
    environment: Mapping[str, str],
    folder: Path,
    report: Callable[[int], None],
    stall_s: float = STALL_S,
    most: int | None = None,
) -> None:
    """Run this Python with `arguments` as a child process, isolated from the working folder.

    `report` is called with the number of bytes under `folder`, up to twenty times a second. The
    child never outlives the call. It is stopped on Ctrl-C, if `report` raises an exception, if
    nothing was written for `stall_s` seconds, or if `folder` has more than `most` bytes. Raises
    PullError if it is stopped, or if it fails; in this case, with the last line of its output.
    """
    with tempfile.TemporaryFile() as output:
        child = subprocess.Popen(
            python_command(*arguments),
            cwd=OWN_FOLDER,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            env={**os.environ, **environment},
            start_new_session=True,
        )
        try:
            _watch(child, folder, report, stall_s, most)
        finally:
            _stop(child)
        if child.returncode != 0:
            output.seek(max(0, output.seek(0, os.SEEK_END) - LAST_WORDS))
            raise PullError(_last_words(output.read().decode("utf-8", "replace")))


def _watch(
    child: subprocess.Popen[bytes],
    folder: Path,
    report: Callable[[int], None],
    stall_s: float,
    most: int | None,
) -> None:
    size, since = -1, time.monotonic()
    while True:
        try:
            child.wait(timeout=POLL_S)
            return
        except subprocess.TimeoutExpired:
            now = folder_size(folder)
            if most is not None and now > most:
                raise PullError(f"stopped after more than {most / 1e6:.0f} MB") from None
            if now != size:
                size, since = now, time.monotonic()
                report(size)
            elif time.monotonic() - since > stall_s:
                raise PullError(f"stopped because no data arrived for {stall_s:.0f} s") from None


def _stop(child: subprocess.Popen[bytes]) -> None:
    if child.poll() is not None:
        return
    child.send_signal(signal.SIGTERM)
    try:
        child.wait(timeout=STOP_S)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()


def _last_words(output: str) -> str:
    """Return the line of `output` with the error, as pip and Python write it."""
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    errors = [line.removeprefix("ERROR:").strip() for line in lines if line.startswith("ERROR:")]
    return (errors or lines or ["it ended without a message"])[-1]
