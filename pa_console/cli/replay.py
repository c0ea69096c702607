"""`pa-console replay`: verify a session log, or play it back."""

from pathlib import Path
from typing import Annotated

import typer

from pa_console.cli.output import BAD_INPUT, JsonOption, errors, out, print_json
from pa_console.resources import find_data
from pa_console.schema.document import DocumentError
from pa_console.schema.event import SessionStarted
from pa_console.session.chain import LogError
from pa_console.session.reader import verify


def replay(
    log: Annotated[Path, typer.Argument(help="A session log (JSONL).")],
    check: Annotated[
        bool, typer.Option("--verify", help="Check the hash chain and name the first bad line.")
    ] = False,
    again: Annotated[
        bool,
        typer.Option(
            "--resimulate", help="Run the session again: its telemetry must come out equal."
        ),
    ] = False,
    world: Annotated[
        str | None, typer.Option("--world", help="The session's world, when it is a file.")
    ] = None,
    scenario: Annotated[
        str | None, typer.Option("--scenario", help="The session's situation, when it is a file.")
    ] = None,
    no_mouse: Annotated[bool, typer.Option(help="Leave the mouse to the terminal.")] = False,
    json: JsonOption = False,
) -> None:
    """Play LOG back in the console, check its chain, or run it again and compare."""
    if not log.is_file():
        raise ValueError(f"{log}: there is no such log")
    if check:
        _verify(log, json)
    if again:
        _resimulate(log, world, scenario, json)
    if check or again:
        return
    _play(log, world, mouse=not no_mouse)


def _play(log: Path, world: str | None, mouse: bool) -> None:
    """Open the console on a recording, with the world and the rules that it names."""
    from pa_console.orchestrator.compose import load_site  # noqa: PLC0415 - only when it is shown
    from pa_console.policy.retriever import Retriever  # noqa: PLC0415
    from pa_console.session.replay import Player  # noqa: PLC0415
    from pa_console.tui.app import ConsoleApp  # noqa: PLC0415

    player = Player.open(log)
    started = player.recording[0].data
    if not isinstance(started, SessionStarted):
        raise LogError(str(log), 1, "the log does not begin with the start of a session")
    site = load_site(_world_of(started, world), started.rules)
    if (site.world_sha256, site.rulebook.sha256) != (started.world_sha256, started.rules_sha256):
        errors.print("note: the world or the rules have changed since this session", style="yellow")
    retriever = Retriever(site.rulebook.rules)
    ConsoleApp(site.world, None, site.rulebook, retriever, player=player).run(mouse=mouse)


def _resimulate(log: Path, world: str | None, scenario: str | None, json: bool) -> None:
    """Run a recorded session again in a fresh simulation and compare its telemetry.

    A log that cannot be read to its end is compared up to there, and then raises its LogError.
    """
    from pa_console.evaluation.twin import resimulate  # noqa: PLC0415 - only when it is asked for
    from pa_console.orchestrator.compose import open_scenario, open_world  # noqa: PLC0415
    from pa_console.session.recording import Recording  # noqa: PLC0415

    recording = Recording.read(log)
    started = recording[0].data
    if not isinstance(started, SessionStarted):
        raise LogError(str(log), 1, "the log does not begin with the start of a session")
    place, path = open_world(_world_of(started, world))
    played = scenario or started.scenario
    try:
        situation = open_scenario(place, path, played).scenario if played else None
    except DocumentError as error:
        if scenario is not None:
            raise
        raise ValueError(f"{error}; give the session's own file with --scenario") from error
    with errors.status(f"running {len(recording)} events again"):
        twin = resimulate((recording[index] for index in range(len(recording))), place, situation)
    if json:
        print_json(twin)
    elif twin.equal:
        out.print(
            f"{log}: {twin.pictures} pictures, all equal; SHA-256 {twin.repeated_sha256}",
            markup=False,
            soft_wrap=True,
        )
    else:
        errors.print(
            f"{log}: {twin.different} of {twin.pictures} pictures differ, first at "
            f"{twin.first_difference}",
            markup=False,
        )
    if not twin.equal:
        raise typer.Exit(1)
    if recording.problem is not None:
        raise recording.problem


def _verify(log: Path, json: bool) -> None:
    result = verify(log)
    if json:
        print_json(result)
    elif result.ok:
        out.print(f"{log}: {result.lines} lines, chain intact. {result.note}", markup=False)
    else:
        errors.print(f"{log}:{result.first_bad_line}: {result.problem}", markup=False)
    if not result.ok:
        raise typer.Exit(BAD_INPUT)


def _world_of(started: SessionStarted, given: str | None) -> str:
    """Return where the session's world is; raises ValueError when it is not installed here."""
    name = given or started.world
    if not find_data("worlds", name, "world.yaml").is_file():
        raise ValueError(
            f"the world {name!r} of this session is not installed here; give its file with --world"
        )
    return name
