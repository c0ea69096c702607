"""`pa-console replay`: verify a session log, or play it back."""

from pathlib import Path
from typing import Annotated

import typer

from pa_console.cli.output import BAD_INPUT, JsonOption, errors, out, print_json
from pa_console.schema.event import SessionStarted
from pa_console.session.chain import LogError
from pa_console.session.reader import verify


def replay(
    log: Annotated[Path, typer.Argument(help="A session log (JSONL).")],
    check: Annotated[
        bool, typer.Option("--verify", help="Check the hash chain and name the first bad line.")
    ] = False,
    no_mouse: Annotated[bool, typer.Option(help="Leave the mouse to the terminal.")] = False,
    json: JsonOption = False,
) -> None:
    """Play LOG back in the console, or check its chain with --verify."""
    if not log.is_file():
        raise ValueError(f"{log}: there is no such log")
    if check:
        _verify(log, json)
        return
    _play(log, mouse=not no_mouse)


def _play(log: Path, mouse: bool) -> None:
    """Open the console on a recording, with the world and the rules that it names."""
    from pa_console.orchestrator.compose import load_site  # noqa: PLC0415 - only when it is shown
    from pa_console.policy.retriever import Retriever  # noqa: PLC0415
    from pa_console.session.replay import Player  # noqa: PLC0415
    from pa_console.tui.app import ConsoleApp  # noqa: PLC0415

    player = Player.open(log)
    started = player.recording[0].data
    if not isinstance(started, SessionStarted):
        raise LogError(str(log), 1, "the log does not begin with the start of a session")
    site = load_site(started.world, started.rules)
    if (site.world_sha256, site.rulebook.sha256) != (started.world_sha256, started.rules_sha256):
        errors.print("note: the world or the rules have changed since this session", style="yellow")
    retriever = Retriever(site.rulebook.rules)
    ConsoleApp(site.world, None, site.rulebook, retriever, player=player).run(mouse=mouse)


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
