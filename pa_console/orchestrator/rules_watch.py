"""Watches the rule file in force, and loads what it has become once it is written to its end."""

import asyncio
import os
from pathlib import Path

from pa_console.policy.allowance import DEADLINE_S
from pa_console.policy.core import with_core
from pa_console.policy.rulebook import Rulebook, load_rules
from pa_console.policy.rules_pin import RulesPins, downgrade, pin_of
from pa_console.policy.seal import refuse_altered, signature_path
from pa_console.schema.document import DocumentError
from pa_console.signing import SigningError

Stamp = tuple[tuple[int, int, int] | None, ...]


class RulesWatch:
    """Compares the file and its signature with what was loaded last."""

    def __init__(
        self,
        path: Path,
        *,
        unsigned: bool = False,
        pins: RulesPins | None = None,
        deadline_s: float = DEADLINE_S,
    ) -> None:
        """The file at `path` has just been loaded; `unsigned` takes an altered signed set too.

        Without `pins` a set is held against the one in force, and nothing is kept of it.
        """
        self.path = path
        self._unsigned, self._pins, self._deadline_s = unsigned, pins, deadline_s
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

    def refusal(self, old: Rulebook, new: Rulebook) -> str:
        """Return why `new` is less than what was used before, "" when it is taken.

        Raises RefusedRulesError when that cannot be found out.
        """
        if self._unsigned and new.seal.altered:
            return ""
        if self._pins is not None:
            return self._pins.refusal(new.name, new.seal)
        return downgrade(pin_of(old.name, old.seal), pin_of(new.name, new.seal))

    def admit(self, new: Rulebook, why: str) -> Rulebook:
        """Return `new` as it goes in force, pinned; `why` is why the operator had to accept it.

        Raises RefusedRulesError, and OSError when nothing can be pinned.
        """
        seal = new.seal.model_copy(update={"accepted": why})
        if self._pins is not None:
            accept = bool(why) or (self._unsigned and new.seal.altered)
            seal = self._pins.admit(new.name, new.seal, accept=accept)
        return with_core(new.sealed(seal), self._deadline_s)

    def _load(self) -> Rulebook:
        try:
            rulebook = load_rules(self.path, self._deadline_s)
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
