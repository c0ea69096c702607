"""The persistent memory of a vehicle: used tokens, and the newest signed messages."""

import sqlite3
from pathlib import Path
from typing import Literal

from pa_console.fleets.authorization.messages import MOST_USED


class Memory:
    """The used tokens and the newest signed messages of a vehicle.

    With a `path` they survive a restart and a power cut: a token is on the disk before its command
    is carried out. Raises OSError or sqlite3.Error when that file cannot be used.
    """

    def __init__(self, path: Path | None = None, most: int = MOST_USED) -> None:
        """Keep the last `most` entries of each kind."""
        self._most = most
        if path is not None:
            path.touch(mode=0o600)
        self._base = sqlite3.connect(str(path or ":memory:"), check_same_thread=False)
        self._base.executescript(
            "PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL;"
            "CREATE TABLE IF NOT EXISTS used"
            " (kind TEXT, name TEXT, until REAL NOT NULL, PRIMARY KEY (kind, name));"
            "CREATE INDEX IF NOT EXISTS used_until ON used (kind, until);"
            "CREATE TABLE IF NOT EXISTS kept (name TEXT PRIMARY KEY, value TEXT NOT NULL);"
        )
        query = "SELECT kind, count(*) FROM used GROUP BY kind"
        self._count = {str(kind): int(count) for kind, count in self._base.execute(query)}

    def use(self, kind: str, name: str, until: float) -> Literal["", "used", "forgotten"]:
        """Remember that `name`, good `until` then, is used; "" if it was not used before.

        What ended no later than something that was forgotten may have been used: "forgotten".
        """
        if until <= float(self.kept(f"{kind} horizon") or 0.0):
            return "forgotten"
        with self._base:
            try:
                self._base.execute("INSERT INTO used VALUES (?, ?, ?)", (kind, name, until))
            except sqlite3.IntegrityError:
                return "used"
            self._count[kind] = self._count.get(kind, 0) + 1
            if self._count[kind] > self._most:
                self._forget(kind)
        return ""

    def kept(self, name: str) -> str:
        """Return the value stored under `name`, '' if there is none."""
        row = self._base.execute("SELECT value FROM kept WHERE name = ?", (name,)).fetchone()
        return str(row[0]) if row is not None else ""

    def keep(self, name: str, value: str) -> None:
        """Store `value` under `name` and replace the earlier value."""
        with self._base:
            self._base.execute("INSERT OR REPLACE INTO kept VALUES (?, ?)", (name, value))

    def close(self) -> None:
        """Let go of the file."""
        self._base.close()

    def _forget(self, kind: str) -> None:
        """Forget the half that ends first; nothing that ended by then is ever taken again."""
        query = "SELECT until FROM used WHERE kind = ? ORDER BY until LIMIT 1 OFFSET ?"
        row = self._base.execute(query, (kind, self._count[kind] // 2)).fetchone()
        query = "DELETE FROM used WHERE kind = ? AND until <= ?"
        self._count[kind] -= self._base.execute(query, (kind, row[0])).rowcount
        horizon = (f"{kind} horizon", repr(float(row[0])))
        self._base.execute("INSERT OR REPLACE INTO kept VALUES (?, ?)", horizon)
