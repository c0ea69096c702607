"""How much is fetched at the most, and whether there is room for it."""

import shutil
from pathlib import Path

from pa_console.llm.cache import CACHE_VARIABLE
from pa_console.llm.errors import PullError

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
    """Return how large something may be of which `expected` bytes, to the megabyte, are announced.

    What is larger is something else, and is not kept until its hash shows that.
    """
    return expected * 11 // 10 + SLACK
