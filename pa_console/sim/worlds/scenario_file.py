"""Scenario files: loading, and checking that all names in them exist in the world."""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pa_console.schema.document import Document, DocumentError, FieldPath, read_bytes
from pa_console.schema.incident import (
    After,
    AssetIs,
    FalseContact,
    Incident,
    ObstructWay,
    RevealTrack,
    Scenario,
    SpawnTrack,
    TrackIs,
    unknown_name,
)
from pa_console.schema.world import World

FOLDER = "scenarios"
"""The folder of a world's scenarios, beside its world file."""

FieldProblem = tuple[FieldPath, str]


@dataclass(frozen=True)
class LoadedScenario:
    """A scenario and the hash of its file."""

    scenario: Scenario
    sha256: str


def open_scenario(world: World, world_path: Path, name: str) -> LoadedScenario:
    """Load a scenario of `world` by name, or from a path; raises DocumentError."""
    path = scenario_path(world_path, name)
    scenario = load_scenario(path, world)
    return LoadedScenario(scenario, hashlib.sha256(read_bytes(path)).hexdigest())


def load_scenario(path: Path, world: World) -> Scenario:
    """Read the scenario at `path` for `world`; raises DocumentError with file, line and field.

    The scenario may name only assets, cameras, gates and frames of the world, and contacts that it
    spawns itself. A gate at which contacts come down a lane must have a lane.
    """
    document = Document.read(path)
    scenario = document.parse(Scenario)
    for field, problem in scenario_problems(scenario, world):
        raise document.error(field, problem)
    return scenario


def scenario_path(world_path: Path, name: str) -> Path:
    """Return the scenario file for `name`, which is a path or a scenario of the world.

    Raises DocumentError, with the names of the world's scenarios, if there is neither.
    """
    given = Path(name).expanduser()
    if given.is_file():
        return given
    folder = world_path.parent / FOLDER
    own = folder / f"{name}.yaml"
    if own.is_file() and own.parent == folder:
        return own
    names = ", ".join(path.stem for path in sorted(folder.glob("*.yaml"))) or "none"
    raise DocumentError(
        name, 0, "", f"there is no such scenario file, nor one in {folder}; known there: {names}"
    )


def list_scenarios(world_path: Path) -> list[tuple[str, str]]:
    """Return (name, title) of every scenario beside the world file, sorted by name.

    `scenario_path` accepts the same names. Raises DocumentError for a broken file.
    """
    files = sorted((world_path.parent / FOLDER).glob("*.yaml"))
    return [(path.stem, Document.read(path).parse(Scenario).title) for path in files]


def scenario_problems(scenario: Scenario, world: World) -> Iterator[FieldProblem]:
    """Yield (field, problem and remedy) for each unknown or impossible reference."""
    yield from _spawned_twice(scenario)
    yield from _never(scenario)
    spawned = {incident.name for _, incident in _incidents(scenario) if incident.kind == "spawn"}
    with_lane = sorted({lane.gate for lane in world.lanes.values()})
    for field, incident in _incidents(scenario):
        missing, remedy = unknown_name(incident, world)
        if missing:
            yield (*field, missing), remedy
        match incident:
            case SpawnTrack(gate=gate) | FalseContact(gate=gate):
                if not missing and gate not in with_lane:
                    names = ", ".join(with_lane) or "none"
                    yield (
                        (*field, "gate"),
                        f"no lane leads to {gate!r}; gates with a lane: {names}",
                    )
            case RevealTrack(track=track) if track not in spawned:
                names = ", ".join(sorted(name for name in spawned if name)) or "none"
                problem = f"no spawn is named {track!r}; names in this file: {names}"
                yield (*field, "track"), problem
            case ObstructWay(start=start, end=end) if start == end:
                yield (*field, "end"), "start and end are the same point"
            case _:
                pass
    for index, event in enumerate(scenario.events):
        if isinstance(event.when, AssetIs):
            field = ("events", index, "when")
            missing, remedy = unknown_name(event.when, world)
            if missing:
                yield (*field, missing), remedy
            if event.when.at is not None and event.when.at not in world.frames:
                names = ", ".join(world.frames)
                yield (
                    (*field, "at"),
                    f"there is no frame {event.when.at!r} in this world; known: {names}",
                )


def _incidents(scenario: Scenario) -> Iterator[tuple[FieldPath, Incident]]:
    for index, event in enumerate(scenario.events):
        yield ("events", index, "do"), event.do
    for index, process in enumerate(scenario.random):
        for number, incident in enumerate(process.do):
            yield ("random", index, "do", number), incident


def _spawned_twice(scenario: Scenario) -> Iterator[FieldProblem]:
    """Yield the names that are given to two contacts."""
    seen: set[str] = set()
    for field, incident in _incidents(scenario):
        if isinstance(incident, SpawnTrack) and incident.name is not None:
            if incident.name in seen:
                yield (*field, "name"), f"{incident.name!r} is spawned twice; use two names"
            seen.add(incident.name)


def _never(scenario: Scenario) -> Iterator[FieldProblem]:
    """Yield events that wait for themselves, directly or through other events or contacts."""
    spawner = {
        event.do.name: index
        for index, event in enumerate(scenario.events)
        if isinstance(event.do, SpawnTrack) and event.do.name
    }
    named = {event.name: index for index, event in enumerate(scenario.events) if event.name}

    def awaited(index: int) -> int | None:
        match scenario.events[index].when:
            case After(event=name):
                return named.get(name)
            case TrackIs(track=name):
                return spawner.get(name)
            case _:
                return None

    followed: set[int] = set()
    waiting: set[int] = set()
    for index in range(len(scenario.events)):
        way: dict[int, None] = {}
        step: int | None = index
        while step is not None and step not in followed:
            followed.add(step)
            way[step] = None
            step = awaited(step)
        if step in way:
            steps = list(way)
            waiting.update(steps[steps.index(step) :])
    for index in sorted(waiting):
        yield ("events", index, "when"), "it waits for itself and can never happen"
