"""Keeps the index of a large log in a folder of the user's, so that it opens at once next time.

The file is one line of JSON (the log's own size and times, the sizes of what follows and their
checksum), the columns as they are in memory, and the packed states and missions. It is used only
if it is whole, of the log as it is now, and made by the same code on the same kind of machine.
"""

import hashlib
import io
import json
import os
import shutil
import sys
import tempfile
import zlib
from array import array
from contextlib import suppress
from datetime import datetime
from functools import cache
from pathlib import Path
from typing import IO, Any

import pa_console.schema
from pa_console.private_files import make_private_folder
from pa_console.session.chain import LogError
from pa_console.session.log_index import LogIndex

KEPT = 12
"""So many indexes are kept, those used last."""

_SUFFIX = ".replay-index"
_CHUNK = 1 << 20


def identity(file: IO[bytes]) -> list[int]:
    """Return what changes whenever an open log does: device, file, size and times."""
    stat = os.fstat(file.fileno())
    return [stat.st_dev, stat.st_ino, stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns]


def index_path(folder: Path, log: Path) -> Path:
    """Return where in `folder` the index of `log` is kept."""
    name = hashlib.sha256(os.fsencode(log.resolve())).hexdigest()[:32]
    return folder / f"{name}{_SUFFIX}"


def load_index(path: Path, log: Path, known: list[int]) -> LogIndex | None:
    """Return the index at `path` if it is whole and of the `log` whose identity is `known`."""
    try:
        file = path.open("rb")
        try:
            index = _read(file, log, known)
        except BaseException:
            file.close()
            raise
        with suppress(OSError):
            os.utime(path)
    except (OSError, ValueError, KeyError, TypeError, EOFError):
        return None
    return index


def save_index(path: Path, index: LogIndex, known: list[int]) -> None:
    """Write the index to `path`, wholly or not at all; raises OSError."""
    make_private_folder(path.parent)
    timeline = index.timeline
    columns = {name: column.tobytes() for name, column in index.columns.items()}
    parts = [*columns.values(), bytes(timeline.kinds), bytes(timeline.mark_kinds)]
    blobs, total = index.blobs, index.blobs.seek(0, io.SEEK_END)
    problem = index.problem
    header = {
        "made_by": _made_by(),
        "log": known,
        "sizes": [len(part) for part in parts],
        "blobs": total,
        "checksum": _checksum(parts, blobs, 0),
        "missions": index.missions,
        "start": timeline.start.isoformat() if timeline.start else "",
        "ticks_per_s": timeline.ticks_per_s,
        "problem": [problem.line, problem.problem] if problem else None,
    }
    handle, name = tempfile.mkstemp(dir=path.parent, suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(json.dumps(header).encode() + b"\n")
            for part in parts:
                file.write(part)
            blobs.seek(0)
            shutil.copyfileobj(blobs, file, _CHUNK)
        os.replace(name, path)
    except BaseException:
        with suppress(OSError):
            os.unlink(name)
        raise
    _drop_oldest(path.parent)


def _read(file: IO[bytes], log: Path, known: list[int]) -> LogIndex:
    """Return the index in `file`; raises ValueError when it is not to be used."""
    header: dict[str, Any] = json.loads(file.readline())
    if header["made_by"] != _made_by() or header["log"] != known:
        raise ValueError("of another log, or made by other code")
    parts = [file.read(size) for size in header["sizes"]]
    first = file.tell()
    if _checksum(parts, file, first) != header["checksum"]:
        raise ValueError("damaged")
    index = LogIndex(file, first)
    timeline = index.timeline
    *columns, kinds, mark_kinds = parts
    for column, part in zip(index.columns.values(), columns, strict=True):
        del column[:]
        column.frombytes(part)
    timeline.kinds, timeline.mark_kinds = bytearray(kinds), bytearray(mark_kinds)
    timeline.start = datetime.fromisoformat(header["start"]) if header["start"] else None
    timeline.ticks_per_s = header["ticks_per_s"]
    index.missions = header["missions"]
    if header["problem"] is not None:
        index.problem = LogError(str(log), *header["problem"])
    return index


def _checksum(parts: list[bytes], blobs: IO[bytes], first: int) -> int:
    total = 0
    for part in parts:
        total = zlib.crc32(part, total)
    blobs.seek(first)
    while chunk := blobs.read(_CHUNK):
        total = zlib.crc32(chunk, total)
    return total


@cache
def _made_by() -> str:
    """Return what stands for the code that folds, and for how this machine writes numbers."""
    digest = hashlib.sha256(f"{sys.byteorder} {array('Q').itemsize}".encode())
    for folder in (Path(__file__).parent, Path(pa_console.schema.__path__[0])):
        for file in sorted(folder.glob("*.py")):
            digest.update(file.read_bytes())
    return digest.hexdigest()


def _drop_oldest(folder: Path) -> None:
    with suppress(OSError):
        files = sorted(folder.glob(f"*{_SUFFIX}"), key=lambda file: file.stat().st_mtime_ns)
        for file in files[:-KEPT]:
            file.unlink()
