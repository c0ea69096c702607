"""The input and the output of exports.

The input is a session log with its rules and its world; an output is written completely or not at
all.
"""

import os
import shutil
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from pa_console.policy.rulebook import load_rules
from pa_console.resources import find_data
from pa_console.schema.events.event import SessionStarted
from pa_console.schema.rule import Rule
from pa_console.schema.world import World
from pa_console.session.log.writer import refuse_audit_file
from pa_console.session.mission_trace import MissionTrace
from pa_console.session.recording import Player, Recording
from pa_console.session.state import SessionState
from pa_console.sim.worlds.world_file import open_world
from pa_console.station.assembly import Site, load_site


@contextmanager
def whole_file(path: Path, log: Path) -> Generator[BinaryIO]:
    """Yield a file that replaces `path` if the block succeeds, and is removed otherwise.

    Raises ValueError if `path` is a folder, the `log` itself or any other file of an audit.
    """
    if path.is_dir():
        raise ValueError(f"{path}: this is a folder; give a file")
    if path.exists() and path.samefile(log):
        raise ValueError(f"{path}: this is the log itself; choose another file")
    refuse_audit_file(path)
    part = _beside(path)
    try:
        with part.open("xb") as file:
            yield file
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


@contextmanager
def whole_folder(path: Path) -> Generator[Path]:
    """Yield a folder that is renamed to `path` if the block succeeds, and is removed otherwise.

    Raises ValueError if `path` exists and is not an empty folder.
    """
    if path.exists() and not (path.is_dir() and not any(path.iterdir())):
        raise ValueError(f"{path} exists; choose a new or an empty folder")
    part = _beside(path)
    part.mkdir()
    try:
        yield part
        if path.exists():
            path.rmdir()
        part.rename(path)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _beside(path: Path) -> Path:
    """Return a hidden path in the folder of `path`, unique to this process."""
    if not path.parent.is_dir():
        raise ValueError(f"{path}: the folder {path.parent} does not exist")
    return path.with_name(f".{path.name}.{os.getpid()}.part")


@dataclass(frozen=True)
class OpenedSession:
    """A recording and its first event."""

    path: Path
    recording: Recording
    started: SessionStarted

    def final_state(self) -> SessionState:
        """Return the state of the session after its last event, as screens show it."""
        player = Player(self.recording)
        player.seek(player.duration)
        return player.state


def open_session(log: Path) -> OpenedSession:
    """Read `log` up to its first bad line.

    Raises ValueError if there is no such file, and LogError if its first line is not the start
    of a session.
    """
    if not log.is_file():
        raise ValueError(f"{log}: there is no such log")
    recording = Recording.read(log)
    return OpenedSession(log, recording, recording.started)


def rules_of(started: SessionStarted, given: str | None) -> tuple[dict[str, Rule], str]:
    """Return the session's rules by id, and a note if they are missing or have changed.

    If the rules are not installed here, the mapping is empty. Raises DocumentError if the file of
    the rules, `given` or installed, cannot be read.
    """
    name = given or started.rules
    path = find_data("rules", name, "rules.yaml")
    if given is None and not path.is_file():
        return {}, f"the rules {name!r} of this session are not installed; only ids are shown"
    book = load_rules(path)
    changed = book.sha256 != started.rules_sha256
    note = "the rules have changed since this session" if changed else ""
    return {rule.id: rule for rule in book.rules}, note


def world_of(started: SessionStarted, given: str | None) -> World | None:
    """Return the session's world, `given` or installed; None if there is neither."""
    name = given or started.world
    if given is None and not find_data("worlds", name, "world.yaml").is_file():
        return None
    return open_world(name)[0]


def site_of(started: SessionStarted, world: str | None, rules: str | None) -> Site:
    """Return the world and rules for screenshots of a session, by default the session's own.

    Raises ValueError if they are not installed here, and DocumentError if they cannot be read.
    """
    for kind, file, name, given in (
        ("worlds", "world.yaml", started.world, world),
        ("rules", "rules.yaml", started.rules, rules),
    ):
        if given is None and not find_data(kind, name, file).is_file():
            raise ValueError(
                f"the {file.removesuffix('.yaml')} {name!r} of this session is not installed here; "
                f"give its file with --{file.removesuffix('.yaml')}"
            )
    return load_site(world or started.world, rules or started.rules, unsigned=True)


def choose_mission(missions: Mapping[str, MissionTrace], wanted: str) -> MissionTrace:
    """Return the mission whose id is `wanted` or begins with it.

    Raises ValueError, with the session's missions, if no mission fits or more than one.
    """
    if not missions:
        raise ValueError("the session has no mission")
    names = ", ".join(missions)
    if wanted in missions:
        return missions[wanted]
    begun = [name for name in missions if wanted and name.startswith(wanted)]
    if len(begun) > 1:
        raise ValueError(f"--mission {wanted}: ambiguous; choose one of {', '.join(begun)}")
    if not begun:
        raise ValueError(f"--mission {wanted}: there is no such mission; choose one of {names}")
    return missions[begun[0]]
