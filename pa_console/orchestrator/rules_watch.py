"""Watches the rule file in force, and loads what it has become once it is written to its end."""

import asyncio
import os
from pathlib import Path

from pa_console.policy.rulebook import Rulebook, load_rules
from pa_console.policy.seal import refuse_altered, signature_path
from pa_console.schema.document import DocumentError
from pa_console.signing import SigningError

Stamp = tuple[tuple[int, int, int] | None, ...]


class RulesWatch:
    """Compares the file and its signature with what was loaded last."""

    def __init__(self, path: Path, *, unsigned: bool = False) -> None:
        """The file at `path` has just been loaded; `unsigned` takes an altered signed set too."""
        self.path = path
        self._unsigned = unsigned
        self._loaded = self._seen = self._stamp()

    def look(self) -> bool:
        """Return whether the file is another than was loaded, and as it was at the last look."""
        now = self._stamp()
        before, self._seen = self._seen, now
        return now == before and now != self._loaded

    async def load(self) -> Rulebook:
        """Return the rules that the file holds now, read beside the event loop.

        Raises ValueError with file, place and problem when they cannot be in force.
        """
        self._loaded = self._stamp()
        return await asyncio.to_thread(self._load)

    def _load(self) -> Rulebook:
        try:
            rulebook = load_rules(self.path)
            if not self._unsigned:
                refuse_altered(self.path, rulebook.seal)
        except (DocumentError, SigningError, OSError) as error:
            raise ValueError(str(error)) from error
        return rulebook

    def _stamp(self) -> Stamp:
        return tuple(_stamp(path) for path in (self.path, signature_path(self.path)))


def _stamp(path: Path) -> tuple[int, int, int] | None:
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_ino, found.st_size, found.st_mtime_ns
