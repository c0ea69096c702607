"""Opens the console on a recording."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from pa_console.cli.progress_bars import read_recording
from pa_console.end_signals import end_signals, exit_code_of
from pa_console.resources import find_data
from pa_console.schema.events.event import SessionStarted
from pa_console.session.recording import Recording
from pa_console.settings.sources import LoadedSettings
from pa_console.station.assembly import SessionSites, Site, load_site
from pa_console.terminal.output import errors, require_keys

if TYPE_CHECKING:
    from pa_console.tui.app import Opening


def play(log: Path, world: str | None, settings: LoadedSettings) -> None:
    """Show the recording, with the world and the rules that it names."""
    recording = read_recording(log)
    run_console(site_of(recording, log, world), recording, settings)


def run_console(
    site: Site, recording: Recording, settings: LoadedSettings, opening: "Opening | None" = None
) -> None:
    """Run the console over the recording, until it is left; `opening` shows other screens first."""
    from pa_console.policy.retriever import Retriever  # noqa: PLC0415 - only when it is shown
    from pa_console.session.recording import Player  # noqa: PLC0415
    from pa_console.tui.app import ConsoleApp  # noqa: PLC0415

    require_keys("use --verify or --compare in scripts")
    app = ConsoleApp(
        site.world,
        None,
        site.rulebook,
        Retriever(site.rulebook.rules),
        player=Player(recording),
        settings=settings,
        opening=opening,
    )
    leaving = app.controllers.leaving
    with end_signals(leaving.end):
        app.run(mouse=settings.values.mouse)
    if leaving.ended_by:
        raise typer.Exit(exit_code_of(leaving.ended_by))


def site_of(recording: Recording, log: Path, world: str | None) -> Site:
    """Return the world and the rules of a session, and report their changes since.

    Raises LogError for a file that is no session, ValueError when its world is not installed here.
    """
    started = recording.started
    site = load_site(world_of(started, world, log), started.rules, unsigned=True)
    if (site.world_sha256, site.rulebook.sha256) != (started.world_sha256, started.rules_sha256):
        errors.print("note: the world or the rules have changed since this session", style="yellow")
    return site


def world_of(started: SessionStarted, given: str | None, log: Path) -> str:
    """Return where the session's world is: given, installed, or in the evaluation of its log.

    Raises ValueError when it is nowhere.
    """
    name = given or started.world
    if find_data("worlds", name, "world.yaml").is_file():
        return name
    beside = None if given else SessionSites().world_file(started, log)
    if beside is None:
        raise ValueError(
            f"the world {name!r} of this session is not installed here; give its file with --world"
        )
    return str(beside)
