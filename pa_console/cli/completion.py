"""The shell completions: names of worlds, rule files, sessions and models, and words of a mission.

Each function receives the incomplete word and returns the complete words that begin with it. The
shell waits for the result, so only the files with the names are read. An invalid file or folder
gives no completions; the verb itself reports the problem.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path

import typer

from pa_console.resources import data_folder, find_data


def worlds(incomplete: str) -> list[str]:
    """Return the installed worlds that begin with `incomplete`."""
    return _beginning(incomplete, (file.parent.name for file in _installed("worlds/*/world.yaml")))


def rule_files(incomplete: str) -> list[str]:
    """Return the installed rule files that begin with `incomplete`."""
    return _beginning(incomplete, (file.stem for file in _installed("rules/*.yaml")))


def scenarios(context: typer.Context, incomplete: str) -> list[str]:
    """Return the situations of the given world that begin with `incomplete`."""
    from pa_console.sim.worlds.scenario_file import FOLDER  # noqa: PLC0415

    folder = _world_file(context).parent / FOLDER
    return _beginning(incomplete, sorted(file.stem for file in folder.glob("*.yaml")))


def mission_sets(context: typer.Context, incomplete: str) -> list[str]:
    """Return the mission sets beside the given world that begin with `incomplete`."""
    from pa_console.evaluation.jobs import MISSION_SETS  # noqa: PLC0415

    folder = _world_file(context).parent / MISSION_SETS
    return _beginning(incomplete, sorted(file.stem for file in folder.glob("*.yaml")))


def words_of_mission(context: typer.Context, incomplete: str) -> list[str]:
    """Return the mission so far, with the last word completed to an asset or a frame."""
    from pa_console.schema.document import DocumentError  # noqa: PLC0415
    from pa_console.sim.worlds.world_file import load_world  # noqa: PLC0415

    before, space, last = incomplete.rpartition(" ")
    if not last:
        return []
    try:
        world = load_world(_world_file(context))
    except (DocumentError, OSError):
        return []
    names = _beginning(last, (*world.assets, *world.frames))
    return [f"{before}{space}{name}" for name in names]


def models(incomplete: str) -> list[str]:
    """Return the models of the catalogue that begin with `incomplete`."""
    from pa_console.llm.models.catalogue import Catalog  # noqa: PLC0415
    from pa_console.schema.document import DocumentError  # noqa: PLC0415

    try:
        return _beginning(incomplete, (model.name for model in Catalog.load().models))
    except DocumentError:
        return []


def sessions(incomplete: str) -> list[str]:
    """Return the matches among `last` and the ids of the recorded sessions, the newest first."""
    from pa_console.schema.document import DocumentError  # noqa: PLC0415
    from pa_console.session.log.writer import default_folder  # noqa: PLC0415
    from pa_console.session.past_sessions import newest_logs  # noqa: PLC0415
    from pa_console.settings.sources import load_settings  # noqa: PLC0415

    try:
        folder = load_settings().values.logs or default_folder()
    except DocumentError:
        folder = default_folder()
    return _beginning(incomplete, ("last", *(log.stem for log in newest_logs(folder))))


def manual_pages(incomplete: str) -> list[str]:
    """Return the pages of the manual that begin with `incomplete`."""
    from pa_console.manual_pages import load_manual  # noqa: PLC0415

    return _beginning(incomplete, (page.name for page in load_manual().pages))


def settings(incomplete: str) -> list[str]:
    """Return the settings that begin with `incomplete`."""
    from pa_console.settings.schema import describe_settings  # noqa: PLC0415

    return _beginning(incomplete, describe_settings())


def _beginning(incomplete: str, names: Iterable[str]) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]


def _installed(pattern: str) -> Sequence[Path]:
    return sorted(data_folder().glob(pattern))


def _world_file(context: typer.Context) -> Path:
    return find_data("worlds", context.params.get("world") or "checkpoint", "world.yaml")
