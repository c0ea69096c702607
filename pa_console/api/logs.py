"""The log of a session as a program verifies and reads it."""

from collections.abc import Iterator
from pathlib import Path

from pa_console.schema.events.event import Event
from pa_console.session.log import chain, verification


def verify_log(
    path: Path | str, *, keys: frozenset[str] | None = None
) -> verification.VerifyResult:
    """Check every record of a session log, its hash chain, its signatures and its signed head.

    The result's `intact` says that nothing was changed, added or removed since a known key signed
    it, and `problem` what is wrong. `keys` are fingerprints, `SHA256:` and 43 characters, that may
    vouch, by default this machine's. Raises LogError, a ValueError, for a file that cannot be read.
    """
    return verification.verify(Path(path), keys)


def read_log(path: Path | str) -> Iterator[Event]:
    """Yield the events of a session log, oldest first, its chain and signatures unchecked.

    `t` of an event is wall time in UTC, `tick` steps of the fleet's clock. Raises LogError, a
    ValueError that names the line, at the first line that cannot be read.
    """
    return chain.read_log(Path(path))
