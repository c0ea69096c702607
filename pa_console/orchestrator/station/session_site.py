"""Finds the world and the rules that a recorded session ran with, by the hashes in its log."""

import hashlib
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

from pa_console.orchestrator.station.assembly import open_world
from pa_console.policy.rulebook import Rulebook, load_rules
from pa_console.resources import find_data
from pa_console.schema.document import DocumentError, read_bytes
from pa_console.schema.events.event import SessionStarted
from pa_console.schema.world import World

WORLD_FILE = "world.yaml"


def has_rules_of(started: SessionStarted, book: Rulebook) -> bool:
    """Return whether `book` has the very rules of a session, by its file or by their content."""
    content = started.rules_seal.content_sha256 if started.rules_seal is not None else None
    return book.sha256 == started.rules_sha256 or book.seal.content_sha256 == content


class SessionSites:
    """Searches given files, installed ones, and the worlds beside a log.

    An evaluation's folder holds `logs` and `worlds`: there the worlds of its logs are found.
    """

    def __init__(self, worlds: Iterable[str] = (), rules: Iterable[str] = ()) -> None:
        """`worlds` and `rules` are paths or installed names; a folder of worlds is searched."""
        self._given = tuple(worlds)
        self._rules = tuple(rules)
        self._hashes: dict[Path, str] = {}
        self._worlds: dict[str, World] = {}
        self._books: dict[Path, Rulebook] = {}

    def world_of(self, started: SessionStarted, log: Path) -> World:
        """Return the world of a session; raises ValueError when none here has its hash.

        Raises DocumentError when the file cannot be used any more.
        """
        if started.world_sha256 not in self._worlds:
            path = self.world_file(started, log)
            if path is None:
                raise ValueError(
                    f"the world {started.world!r} of this session is not here as it was then "
                    f"(SHA-256 {started.world_sha256[:12]}); give its file with --world"
                )
            self._worlds[started.world_sha256] = open_world(str(path))[0]
        return self._worlds[started.world_sha256]

    def world_file(self, started: SessionStarted, log: Path) -> Path | None:
        """Return the file of a session's world, None when none here has its hash."""
        files = self._files(started, log)
        return next((path for path in files if self._hash(path) == started.world_sha256), None)

    def rules_of(self, started: SessionStarted) -> Rulebook | None:
        """Return the rules of a session, None when none here are what they were."""
        for name in (*self._rules, started.rules):
            path = find_data("rules", name, "rules.yaml")
            if not path.is_file():
                continue
            if path not in self._books:
                self._books[path] = load_rules(path)
            book = self._books[path]
            if has_rules_of(started, book):
                return book
        return None

    def _files(self, started: SessionStarted, log: Path) -> Iterator[Path]:
        for name in self._given:
            yield from _world_files(find_data("worlds", name, WORLD_FILE))
        yield from _world_files(find_data("worlds", started.world, WORLD_FILE))
        yield from _world_files(log.parent.parent / "worlds")

    def _hash(self, path: Path) -> str:
        """Return the SHA-256 of a file, empty for one that no world can be read from."""
        if path not in self._hashes:
            self._hashes[path] = ""
            with suppress(DocumentError):
                self._hashes[path] = hashlib.sha256(read_bytes(path)).hexdigest()
        return self._hashes[path]


def _world_files(place: Path) -> Iterator[Path]:
    if place.is_file():
        yield place
    elif place.is_dir():
        yield from sorted(place.glob(f"*/{WORLD_FILE}"))
        yield from sorted(place.glob("*.yaml"))
