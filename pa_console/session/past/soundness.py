"""Whether the log of a recorded session can be relied on, in one word."""

import fcntl
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pa_console.session.log.chain import LogError
from pa_console.session.log.verification import verify

Standing = Literal["verified", "running", "open", "unsigned", "damaged"]


@dataclass(frozen=True)
class Soundness:
    """What `pa-console replay LOG --verify --chain-only` comes to.

    `verified`: every line is vouched for by a known key. `running`: a console writes it now.
    `open`: sound, but never closed. `unsigned`: sound, and no key vouches for it. `damaged`: not
    what was written, or not readable; `detail` says where.
    """

    standing: Standing
    detail: str = ""


def is_held(log: Path) -> bool:
    """Return whether a console is writing `log` now; raises OSError when it cannot be opened."""
    with log.open("rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        fcntl.flock(file, fcntl.LOCK_UN)
    return False


def soundness(log: Path, known: Collection[str] | None = None) -> Soundness:
    """Check chain, signatures and head of `log`; `known` are fingerprints that may vouch.

    None stands for the keys of this machine.
    """
    try:
        running = is_held(log)
        found = verify(log, known)
    except LogError as error:
        return Soundness("damaged", str(error))
    except OSError as error:
        return Soundness("damaged", f"{log}: {error.strerror or error}")
    if not found.ok and not running:
        line = f"line {found.first_bad_line}: " if found.first_bad_line else ""
        return Soundness("damaged", f"{line}{found.damage}: {found.problem}")
    if running:
        return Soundness("running", "a console is writing this log")
    if found.intact:
        return Soundness("verified", f"every line is signed by {found.key}")
    return Soundness("open" if found.standing == "open" else "unsigned", found.note)
