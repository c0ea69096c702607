"""Verification and reading of session logs by programs."""

from collections.abc import Iterator
from pathlib import Path

from pa_console.schema.events.event import Event
from pa_console.session.log import chain, verification


def verify_log(
    path: Path | str, *, keys: frozenset[str] | None = None
) -> verification.VerifyResult:
    """Check every record of a session log, its hash chain, its signatures and its signed head.

    In the result, `intact` is True if nothing was changed, added or removed since a known key
    signed the log; otherwise, `problem` is the reason. `keys` are the fingerprints of the known
    keys, `SHA256:` and 43 characters; by default, those of this machine. Raises LogError, a
    ValueError, for a file that cannot be read.
    """
    return verification.verify(Path(path), keys)


def read_log(path: Path | str) -> Iterator[Event]:
    """Yield the events of a session log, oldest first, without verifying the log.

    An event's `t` is wall time in UTC, and its `tick` counts the steps of the fleet's clock. Raises
    LogError, a ValueError that names the line, at the first line that cannot be read.
    """
    return chain.read_log(Path(path))
