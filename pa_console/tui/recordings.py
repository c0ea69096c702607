"""Opens a session log to be looked at, with the world and the rules that it names."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

from pa_console.orchestrator.compose import open_world
from pa_console.policy.rulebook import load_rules
from pa_console.resources import find_data
from pa_console.schema.document import DocumentError
from pa_console.schema.event import SessionStarted
from pa_console.schema.rule import Rule
from pa_console.schema.world import World
from pa_console.session.chain import LogError
from pa_console.session.replay import Player


@dataclass(frozen=True)
class OpenedLog:
    """A recording with what the screen needs beside it; `note` is what is not as it was then."""

    player: Player
    world: World
    rules: dict[str, Rule]
    note: str = ""


def open_run(name: str, folder: Path) -> OpenedLog:
    """Open the log `name` of a run in the evaluation's `folder`, wound to its end.

    Its world is found by its hash below `folder`, where generated ones are, else by its name.
    Raises DocumentError for a log or world that cannot be read, ValueError when there is no such
    log or its world is not here.
    """
    if not name:
        raise ValueError("this run kept no log; without --no-logs the next one will")
    log = folder / name
    if not log.is_file():
        raise ValueError(f"{log}: the log of this run is missing; run the mission again to see it")
    player = Player.open(log)
    started = player.recording[0].data
    if not isinstance(started, SessionStarted):
        raise LogError(str(log), 1, "the log does not begin with the start of a session")
    world, notes = _world(started, folder), list[str]()
    if world is None:
        raise ValueError(
            f"{log}: its world {started.world!r} is neither installed nor below {folder}; "
            "copy its world.yaml there"
        )
    if player.recording.problem is not None:
        notes.append(str(player.recording.problem))
    try:
        book = load_rules(find_data("rules", started.rules, "rules.yaml"))
        rules = {rule.id: rule for rule in book.rules}
        if book.sha256 != started.rules_sha256:
            notes.append("the rules have changed since this run")
    except (DocumentError, OSError):
        rules = {}
        notes.append(f"the rules {started.rules!r} of this run are not here: ids without texts")
    player.seek(player.duration)
    return OpenedLog(player, world, rules, "; ".join(notes))


def _world(started: SessionStarted, folder: Path) -> World | None:
    """Return the world of a session: the file with its hash below `folder`, else by its name."""
    for file in sorted(folder.glob("**/world.yaml")):
        if hashlib.sha256(file.read_bytes()).hexdigest() == started.world_sha256:
            return open_world(str(file))[0]
    installed = find_data("worlds", started.world, "world.yaml")
    return open_world(str(installed))[0] if installed.is_file() else None
