"""`pa-console replay`: verify a session log, or play it back."""

from pathlib import Path
from typing import Annotated

import typer

from pa_console.cli.output import BAD_INPUT, JsonOption, errors, out, print_json
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
    from pa_console.tui.app import run_replay  # noqa: PLC0415 - Textual only when it is shown

    run_replay(log, mouse=not no_mouse)


def _verify(log: Path, json: bool) -> None:
    result = verify(log)
    if json:
        print_json(result)
    elif result.ok:
        out.print(f"{log}: {result.lines} lines, chain intact. {result.problem}", markup=False)
    else:
        errors.print(f"{log}:{result.first_bad_line}: {result.problem}", markup=False)
    if not result.ok:
        raise typer.Exit(BAD_INPUT)
