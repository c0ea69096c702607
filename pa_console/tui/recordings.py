"""Opens a session log to be looked at, with the world and the rules that it names."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

from pa_console.llm.cache import cache_folder
from pa_console.orchestrator.compose import open_world
from pa_console.policy.rulebook import load_rules
from pa_console.resources import find_data
from pa_console.schema.document import DocumentError
from pa_console.schema.event import SessionStarted
from pa_console.schema.rule import Rule
from pa_console.schema.world import World
from pa_console.session.chain import LogError
from pa_console.session.log_index import Progress
from pa_console.session.replay import Player


@dataclass(frozen=True)
class OpenedLog:
    """A recording with what the screen needs beside it; `note` is what is not as it was then."""

    player: Player
    world: World
    rules: dict[str, Rule]
    note: str = ""


def index_folder() -> Path:
    """Return where the indexes of large logs are kept."""
    return cache_folder() / "replay"


def log_of_run(name: str, folder: Path) -> Path:
    """Return the log `name` of a run in the evaluation's `folder`; ValueError without one."""
    if not name:
        raise ValueError("this run kept no log; without --no-logs the next one will")
    log = folder / name
    if not log.is_file():
        raise ValueError(f"{log}: the log of this run is missing; run the mission again to see it")
    return log


def open_run(log: Path, folder: Path, progress: Progress | None = None) -> OpenedLog:
    """Open the log of a run in the evaluation's `folder`, wound to its end.

    Raises what `open_log` does.
    """
    opened = open_log(log, folder, progress=progress)
    opened.player.seek(opened.player.duration)
    return opened


def open_log(
    log: Path,
    worlds: Path | None = None,
    otherwise: World | None = None,
    progress: Progress | None = None,
) -> OpenedLog:
    """Open a session log at its beginning, with the world and the rules that it names.

    Its world is found by its hash below the folder `worlds`, where generated ones are, by its
    name, or is the one given for `otherwise`. `progress` is told how many bytes of a log were read
    whose index was not kept. Raises DocumentError for a log or world that cannot be read,
    ValueError without a world.
    """
    player = Player.open(log, index_folder(), progress)
    if not len(player.recording):
        raise LogError(str(log), 1, "the log is empty")
    started = player.recording[0].data
    if not isinstance(started, SessionStarted):
        raise LogError(str(log), 1, "the log does not begin with the start of a session")
    world, notes = _world(started, worlds), list[str]()
    if world is None and otherwise is not None:
        notes.append(f"its world {started.world!r} is not here: {otherwise.name} is shown")
    world = world or otherwise
    if world is None:
        known = "is not installed here"
        if worlds is not None:
            known = f"is neither installed nor below {worlds}; copy its world.yaml there"
        raise ValueError(f"{log}: its world {started.world!r} {known}")
    if player.recording.problem is not None:
        notes.append(str(player.recording.problem))
    try:
        book = load_rules(find_data("rules", started.rules, "rules.yaml"))
        rules = {rule.id: rule for rule in book.rules}
        if book.sha256 != started.rules_sha256:
            notes.append("the rules have changed since this session")
    except (DocumentError, OSError):
        rules = {}
        notes.append(f"the rules {started.rules!r} of this session are not here: ids without texts")
    return OpenedLog(player, world, rules, "; ".join(notes))


def _world(started: SessionStarted, folder: Path | None) -> World | None:
    """Return the world of a session: the file with its hash below `folder`, else by its name."""
    for file in sorted(folder.glob("**/world.yaml")) if folder is not None else ():
        if hashlib.sha256(file.read_bytes()).hexdigest() == started.world_sha256:
            return open_world(str(file))[0]
    installed = find_data("worlds", started.world, "world.yaml")
    return open_world(str(installed))[0] if installed.is_file() else None
