"""Runs a recorded session again: telemetry, rehearsals, and what the rules say of every plan."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import typer

from pa_console.cli.output import FAILED, errors, out, print_json
from pa_console.cli.progress_bars import read_recording
from pa_console.cli.replay.play import started_of
from pa_console.evaluation.changed_decisions import SessionEffect, decided_again
from pa_console.evaluation.runs.twin import Resimulation, resimulate
from pa_console.schema.document import DocumentError
from pa_console.schema.events.event import Event, SessionStarted
from pa_console.schema.incident import Scenario
from pa_console.schema.text import count
from pa_console.schema.world import World
from pa_console.session.log.chain import LogError, line_of
from pa_console.session.recording import Recording
from pa_console.sim.worlds.scenario_file import open_scenario
from pa_console.sim.worlds.world_file import open_world
from pa_console.station.assembly import SessionSites


@dataclass(frozen=True)
class Place:
    """The world, rules and scenario of a session that are not installed here as they were."""

    world: str | None = None
    scenario: str | None = None
    rules: str | None = None


@dataclass(frozen=True)
class Again:
    """The result of a session that was run again; `line` is that of the first other telemetry.

    `decided` is None when the rules of the session are not here.
    """

    twin: Resimulation
    line: int | None
    decided: SessionEffect | None
    problem: LogError | None

    @property
    def equal(self) -> bool:
        """True if everything came out as it was recorded."""
        return self.twin.equal and self.decided is not None and not self.decided.flips

    def document(self) -> dict[str, Any]:
        """Return all of it for `--json`."""
        decided = None if self.decided is None else asdict(self.decided)
        return {**asdict(self.twin), "first_line": self.line, "decided": decided}


def run_again(log: Path, place: Place) -> Again:
    """Run the session of `log` again with its recorded decisions and answers.

    Raises ValueError (DocumentError) when its world or scenario is not here, LogError for a file
    that is no session.
    """
    recording = read_recording(log)
    started = started_of(recording, log)
    sites = SessionSites(
        worlds=[place.world] if place.world else (), rules=[place.rules] if place.rules else ()
    )
    world, path = _world(sites, started, place.world, log)
    situation = _situation(world, path, place.scenario, started)
    with errors.status(f"running {count(len(recording), 'event')} again"):
        twin = resimulate(_events(recording), world, situation)
        rules = sites.rules_of(started)
        decided = None if rules is None else decided_again(_events(recording), world, rules)
    line = line_of(log, twin.first_event) if twin.first_event is not None else None
    return Again(twin, line, decided, recording.problem)


def show_again(log: Path, place: Place, json: bool) -> None:
    """Run the session of `log` again and report the result; leaves with 1 for a difference.

    A log that cannot be read to its end is compared up to there, and then raises its LogError.
    """
    again = run_again(log, place)
    if json:
        print_json(again.document())
    else:
        print_again(log, again)
    if not again.equal:
        raise typer.Exit(FAILED)
    if again.problem is not None:
        raise again.problem


def print_again(log: Path, again: Again) -> None:
    """Print what came out equal, and what did not."""
    twin, decided = again.twin, again.decided
    if twin.equal:
        _say(
            f"{log}: {count(twin.pictures, 'picture')}, all equal, and "
            f"{count(twin.rehearsals, 'rehearsal')} of plans; SHA-256 {twin.repeated_sha256}"
        )
    else:
        at = f"{log}:{again.line}" if again.line is not None else str(log)
        _object(
            f"{at}: {twin.different} of {twin.pictures} pictures and "
            f"{twin.different_rehearsals} of {twin.rehearsals} rehearsals differ, first at "
            f"{twin.first_difference}"
        )
    if decided is None:
        _object(
            f"{log}: the rules of this session are not here as they were: what they said of its "
            "plans was not decided again; give their file with --rules"
        )
        return
    for flip in decided.flips:
        where = f"{flip.mission} attempt {flip.attempt}" if flip.attempt else flip.mission
        rules = ", ".join(flip.rules)
        _object(f"{log}: {where}: {flip.kind} {rules}: recorded {flip.was}, again {flip.now}")
    if not decided.flips:
        left = f"; {len(decided.gaps)} could not be" if decided.gaps else ""
        _say(
            f"{log}: {count(decided.compared, 'finding')} on {count(decided.plans, 'plan')} of "
            f"{count(decided.missions, 'mission')} decided again, all equal{left}"
        )


def _world(
    sites: SessionSites, started: SessionStarted, given: str | None, log: Path
) -> tuple[World, Path]:
    """Return the session's world by its hash, or the one given in its place."""
    path = sites.world_file(started, log)
    if path is None and given is not None:
        _object(f"note: {given} is not the world of this session as it was then")
        return open_world(given)
    world = sites.world_of(started, log)
    assert path is not None
    return world, path


def _situation(
    world: World, path: Path, given: str | None, started: SessionStarted
) -> Scenario | None:
    """Return the session's scenario, if it had one, or the one given in its place.

    Raises ValueError when the one of its name is not the one that its log pins.
    """
    played = given or started.scenario
    if not played:
        return None
    try:
        found = open_scenario(world, path, played)
    except DocumentError as error:
        if given is not None:
            raise
        raise ValueError(f"{error}; give the session's own file with --scenario") from error
    pinned = started.scenario_sha256
    if pinned and found.sha256 != pinned:
        if given is None:
            raise ValueError(
                f"the scenario {played!r} of this session is not here as it was then "
                f"(SHA-256 {pinned[:12]}); give its file with --scenario"
            )
        _object(f"note: {given} is not the scenario of this session as it was then")
    return found.scenario


def _events(recording: Recording) -> Iterator[Event]:
    return (recording[index] for index in range(len(recording)))


def _say(text: str) -> None:
    out.print(text, markup=False, soft_wrap=True)


def _object(text: str) -> None:
    errors.print(text, markup=False, soft_wrap=True)
