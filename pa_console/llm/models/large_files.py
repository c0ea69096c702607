"""Has a child process write a large file: is there room, how much is written, did it stall."""

import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from pa_console.child_processes import OWN_FOLDER, python_command
from pa_console.llm.backend import PullError
from pa_console.llm.models.cache import CACHE_VARIABLE

SLACK = 16_000_000


def require_room(folder: Path, needed: int) -> None:
    """Raise PullError unless `needed` bytes are free on the disk of the existing `folder`."""
    free = shutil.disk_usage(folder).free
    if free < needed:
        raise PullError(
            f"{needed / 1e6:.0f} MB are needed in {folder} and {free / 1e6:.0f} MB are free: "
            f"free some space, or set {CACHE_VARIABLE} to a folder on another disk"
        )


def most_bytes(expected: int) -> int:
    """Return the size limit of a file announced with `expected` bytes, to the megabyte.

    A larger file is another one, and is not kept until its hash shows that.
    """
    return expected * 11 // 10 + SLACK


POLL_S = 0.05
STALL_S = 90.0
STOP_S = 3.0
LAST_WORDS = 64_000
"""The number of bytes at the end of a child's output that are searched for its last words."""


def folder_size(folder: Path) -> int:
    """Return the bytes in all files under `folder`, which may change meanwhile."""
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
    """Run this Python with `arguments`, with nothing of the working folder.

    `report` is called with the bytes under `folder` up to twenty times a second. The child never
    outlives the call: it is stopped on Ctrl-C, when `report` raises, when nothing was written for
    `stall_s` seconds, and when there are more than `most` bytes. Raises PullError with the child's
    last words.
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
                raise PullError(f"more than {most / 1e6:.0f} MB arrived, given up") from None
            if now != size:
                size, since = now, time.monotonic()
                report(size)
            elif time.monotonic() - since > stall_s:
                raise PullError(f"nothing arrived for {stall_s:.0f} s, given up") from None


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
    """Return the line with the error, in the style of pip and Python."""
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    errors = [line.removeprefix("ERROR:").strip() for line in lines if line.startswith("ERROR:")]
    return (errors or lines or ["it ended without a word"])[-1]
