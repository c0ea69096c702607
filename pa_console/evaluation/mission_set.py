"""Loads mission sets: commands with set-up and success conditions."""

from collections.abc import Iterable
from pathlib import Path

from pa_console.schema.document import Document
from pa_console.schema.incident import ClearTracks, SpawnTrack
from pa_console.schema.mission import MissionSet
from pa_console.schema.world import World


def load_missions(path: Path, world: World) -> MissionSet:
    """Read the missions at `path` for `world`; raises DocumentError with file, line and field.

    Ids must be unique, and the set-up may only name assets, frames and gates of the world.
    """
    document = Document.read(path)
    missions = document.parse(MissionSet)
    seen: set[str] = set()
    for index, case in enumerate(missions.missions):
        if case.id in seen:
            raise document.error(("missions", index, "id"), f"{case.id!r} appears twice")
        seen.add(case.id)
        for number, incident in enumerate(case.setup):
            field = ("missions", index, "setup", number)
            if isinstance(incident, SpawnTrack | ClearTracks):
                if incident.gate not in world.gates:
                    raise document.error((*field, "gate"), _unknown(incident.gate, world.gates))
            elif incident.asset not in world.assets:
                raise document.error((*field, "asset"), _unknown(incident.asset, world.assets))
            elif incident.kind == "place" and incident.frame not in world.frames:
                raise document.error((*field, "frame"), _unknown(incident.frame, world.frames))
    return missions


def _unknown(name: str, known: Iterable[str]) -> str:
    return f"{name!r} is not in this world; known: {', '.join(known)}"
