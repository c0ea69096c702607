"""Session logs, opened for a replay or a comparison, with the world and rules that they name."""

import hashlib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Self

from pa_console.llm.models.cache import cache_folder
from pa_console.policy.rulebook import load_rules
from pa_console.resources import find_data
from pa_console.schema.document import DocumentError, read_bytes
from pa_console.schema.events.event import SessionStarted
from pa_console.schema.rule import Rule
from pa_console.schema.world import World
from pa_console.session.log_index import Progress
from pa_console.session.recording import Recording
from pa_console.sim.worlds.world_file import open_world
from pa_console.station.assembly import SessionSites


@dataclass(frozen=True)
class OpenedLog:
    """A recording with its world and its rules; without its world, it has no map.

    `note` describes damage to the log, and a world or rules that are missing or have changed since.
    """

    name: str
    recording: Recording
    world: World | None
    rules: Mapping[str, Rule]
    note: str = ""

    @property
    def how_to_see(self) -> str:
        """The advice to the operator if the world of the recording was not found."""
        return f"pa-console replay {self.name} --world FILE shows it with its map"


@dataclass(frozen=True)
class PlayableLog(OpenedLog):
    """A recording with its world."""

    world: World


class KnownWorld(NamedTuple):
    """A world that is already open, with its hash from the log of the session."""

    world: World
    sha256: str

    @classmethod
    def of(cls, world: World, recording: Recording) -> Self:
        """Return `world` with the hash that the log of `recording` names."""
        started = recording[0].data if len(recording) else None
        return cls(world, started.world_sha256 if isinstance(started, SessionStarted) else "")


def index_folder() -> Path:
    """Return the folder for the indexes of large logs."""
    return cache_folder() / "replay"


def log_of_run(name: str, folder: Path) -> Path:
    """Return the path of the log `name` in an evaluation's `folder`; raise ValueError if absent."""
    if not name:
        raise ValueError("this run kept no log; run the evaluation without --no-logs to keep logs")
    log = folder / name
    if not log.is_file():
        raise ValueError(f"{log}: the log of this run is missing; run the mission again to see it")
    return log


def open_log(
    log: Path, worlds: Path | None = None, progress: Progress | None = None
) -> PlayableLog:
    """Open a session log at its beginning, with the world and the rules that it names.

    The world is found by its hash below the folder `worlds`, which has the generated worlds, or
    else by its name. `progress` receives the number of bytes read of a log without a stored index.
    Raises DocumentError for a log or world that cannot be read, and ValueError if the world is not
    found.
    """
    recording = Recording.read(log, progress, cache=index_folder())
    started = recording.started
    world = _world(started, worlds)
    if world is None:
        problem = "is not installed here"
        if worlds is not None:
            problem = f"is neither installed nor below {worlds}; copy its world.yaml there"
        raise ValueError(f"{log}: its world “{started.world}” {problem}")
    rules, notes = _rules(recording, started)
    return PlayableLog(log.name, recording, world, rules, "; ".join(notes))


def open_compared(log: Path, own: KnownWorld, progress: Progress | None = None) -> OpenedLog:
    """Open a session log for a comparison with a recording of the world `own`.

    The log's world is `own` if their hashes are equal. Otherwise, it is the world of the
    evaluation that has the log, or else the installed world of the same name. A log without a world
    can be compared too. Raises DocumentError for a log or world that cannot be read.
    """
    recording = Recording.read(log, progress, cache=index_folder())
    started = recording.started
    rules, notes = _rules(recording, started)
    if started.world_sha256 == own.sha256:
        return OpenedLog(log.name, recording, own.world, rules, "; ".join(notes))
    file = SessionSites().world_file(started, log)
    world = _world(started, None) if file is None else open_world(str(file))[0]
    if world is None:
        notes.insert(0, f"its world “{started.world}” is not here")
    elif file is None:
        notes.insert(0, f"its world “{started.world}” has changed since")
    return OpenedLog(log.name, recording, world, rules, "; ".join(notes))


def _rules(recording: Recording, started: SessionStarted) -> tuple[dict[str, Rule], list[str]]:
    """Return the rules of a session, and notes about damage to the log and about changed rules."""
    notes = [str(recording.problem)] if recording.problem is not None else []
    try:
        book = load_rules(find_data("rules", started.rules, "rules.yaml"))
    except (DocumentError, OSError):
        notes.append(f"the rules “{started.rules}” of this session are not here: only ids shown")
        return {}, notes
    if book.sha256 != started.rules_sha256:
        notes.append("the rules have changed since this session")
    return {rule.id: rule for rule in book.rules}, notes


def _world(started: SessionStarted, folder: Path | None) -> World | None:
    """Return the world of a session: the file below `folder` with its hash, or else by its name."""
    for file in sorted(folder.glob("**/world.yaml")) if folder is not None else ():
        with suppress(DocumentError):
            if hashlib.sha256(read_bytes(file)).hexdigest() == started.world_sha256:
                return open_world(str(file))[0]
    installed = find_data("worlds", started.world, "world.yaml")
    return open_world(str(installed))[0] if installed.is_file() else None
