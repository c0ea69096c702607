"""The cache of fetched models on this machine; a file is loaded only as it was checked.

A file that takes the place of the checked one afterwards is never read, as its name is not looked
up again. A program that writes into the checked file itself changes its times, which are compared
again whenever it matters: a write of the last milliseconds, which the kernel has not noted yet, is
noticed the next time.
"""

import hashlib
import mmap
import os
from pathlib import Path

from platformdirs import user_cache_path

DESCRIPTORS = Path("/proc/self/fd")


class CheckedFile:
    """An open file with the SHA-256 that was asked for; `route` is the path to load it by.

    Where a descriptor has no path of its own (it has one on Linux), `route` is the file's.
    """

    def __init__(self, path: str, sha256: str) -> None:
        """Open and hash the file, about 1 s per GB; raises ValueError or OSError."""
        self.path, self.sha256 = path, sha256
        self._stream = open(path, "rb", buffering=0)  # noqa: SIM115 - open while it is in use
        own = DESCRIPTORS / str(self._stream.fileno())
        self.route = str(own) if own.exists() else path
        self.size = os.fstat(self._stream.fileno()).st_size
        self._stamp = self._look()
        self._hash()

    def check(self) -> None:
        """Hash the file again if it was written to; raises ValueError when it has changed."""
        now = self._look()
        if now != self._stamp:
            self._hash()
            self._stamp = now

    def _look(self) -> tuple[int, int, int]:
        """Return what the kernel changes with every write."""
        stat = os.fstat(self._stream.fileno())
        return stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns

    def _hash(self) -> None:
        """Hash all of it in one step, in which other threads of this process can go on."""
        digest = hashlib.sha256()
        if os.fstat(self._stream.fileno()).st_size:
            with mmap.mmap(self._stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
                digest.update(content)
        found = digest.hexdigest()
        if found != self.sha256:
            raise ValueError(
                f"{self.path}: not the file that was checked: its SHA-256 is {found}, "
                f"{self.sha256 or 'none'} is expected; start the console again"
            )


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


PIECE = 16 << 20
"""Bytes hashed at a time. A thread that hashes waits for its turn twice a piece, 5 ms each time,
while another one computes: in pieces of 256 KiB it would get nowhere."""


def hash_file(path: Path) -> str:
    """Return the SHA-256 of the file at `path`; about 1 s per GB, other threads go on meanwhile."""
    digest, piece = hashlib.sha256(), memoryview(bytearray(PIECE))
    with path.open("rb", buffering=0) as stream:
        while size := stream.readinto(piece):
            digest.update(piece[:size])
    return digest.hexdigest()
