"""Loads mission sets: commands with set-up and success conditions, and the worlds they name."""

from pathlib import Path

from pa_console.evaluation.scoring.conditions import compile_condition
from pa_console.schema.document import Document
from pa_console.schema.incident import unknown_name
from pa_console.schema.mission_set import MissionSet, WorldFile
from pa_console.schema.world import World
from pa_console.sim.world_file import load_world
from pa_console.sim.world_generator import generate_world


def load_missions(path: Path, world: World) -> MissionSet:
    """Read the missions at `path` for `world`; raises DocumentError with file, line and field."""
    return load_with_worlds(path, world)[0]


def load_with_worlds(path: Path, world: World) -> tuple[MissionSet, dict[str, World]]:
    """Read the missions at `path` for `world`, with every world that they name; "" is `world`.

    Raises DocumentError with file, line and field.
    Ids must be unique, the set-up may only name assets, frames and gates of the mission's own
    world, and its success conditions only what a run in that world can have.
    """
    document = Document.read(path)
    missions = document.parse(MissionSet)
    worlds = {"": world}
    for name, made in missions.worlds.items():
        try:
            if isinstance(made, WorldFile):
                worlds[name] = load_world(path.parent / made.file)
            else:
                worlds[name] = generate_world(made.gates, made.assets, made.seed)
        except ValueError as error:
            raise document.error(("worlds", name), str(error)) from error
    seen: set[str] = set()
    for index, case in enumerate(missions.missions):
        if case.id in seen:
            raise document.error(("missions", index, "id"), f"{case.id!r} appears twice")
        seen.add(case.id)
        for number, incident in enumerate(case.setup):
            field, remedy = unknown_name(incident, worlds[case.world])
            if field:
                raise document.error(("missions", index, "setup", number, field), remedy)
        for number, source in enumerate(case.success):
            try:
                compile_condition(source, worlds[case.world])
            except ValueError as error:
                raise document.error(("missions", index, "success", number), str(error)) from error
    return missions, worlds
