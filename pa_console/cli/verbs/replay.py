"""`pa-console replay`: a recorded session, shown, verified, simulated again or compared."""

from pathlib import Path
from typing import Annotated

import typer

from pa_console.cli import completion
from pa_console.cli.options import JsonOption, MouseOption, SessionRulesOption, SessionWorldOption
from pa_console.cli.settings_defaults import settings_of


def replay(
    context: typer.Context,
    log: Annotated[
        Path | None,
        typer.Argument(
            help="Session: a log file (JSONL) or an id from 'pa-console sessions'.",
            autocompletion=completion.sessions,
        ),
    ] = None,
    last: Annotated[bool, typer.Option("--last", help="Use the most recent session.")] = False,
    check: Annotated[
        bool,
        typer.Option(
            "--verify",
            help="Verify the hash chain, the signatures and the signed head, and report the first "
            "bad line and its damage. Then simulate the session again.",
        ),
    ] = False,
    chain_only: Annotated[
        bool, typer.Option("--chain-only", help="With --verify: do not simulate again.")
    ] = False,
    key: Annotated[
        list[str] | None,
        typer.Option(
            help="With --verify: fingerprint of another trusted key, besides this machine's. "
            "Repeatable."
        ),
    ] = None,
    unsigned: Annotated[
        bool, typer.Option("--unsigned", help="With --verify: accept a log without signatures.")
    ] = False,
    witness: Annotated[
        Path | None,
        typer.Option(
            help="With --verify: file of a witness; the first head in it that the log lacks is "
            "reported."
        ),
    ] = None,
    again: Annotated[
        bool,
        typer.Option(
            "--resimulate",
            help="Only simulate the session again, and report each difference in telemetry, "
            "rehearsals or rule findings.",
        ),
    ] = False,
    world: SessionWorldOption = None,
    scenario: Annotated[
        str | None,
        typer.Option("--scenario", help="Scenario file of the session, if it is not installed."),
    ] = None,
    rules: SessionRulesOption = None,
    other: Annotated[
        Path | None,
        typer.Option(
            "--compare",
            metavar="LOG",
            help="Report the first event that differs from LOG, and how. Exits with 1 if the "
            "sessions differ.",
        ),
    ] = None,
    screen: Annotated[
        bool, typer.Option("--screen", help="With --compare: show both sessions on a screen.")
    ] = False,
    mouse: MouseOption = True,  # noqa: ARG001 - one of the settings
    json: JsonOption = False,
) -> None:
    """Replay a session log in the console, verify it, simulate it again, or compare it.

    --verify exits with 0 if every line is signed with a trusted key and the simulation agrees with
    the log. It exits with 2 if the log or its signed head is damaged, and with 1 if the log is
    sound but not completely signed, or if the simulation fails or differs.
    """
    if last == (log is not None):
        raise ValueError(
            "give a session log, or --last for the most recent session. "
            "See 'pa-console replay --help'."
        )
    from pa_console.cli.sessions import recorded  # noqa: PLC0415 - not needed for help
    from pa_console.cli.sessions.log import recorded_log  # noqa: PLC0415

    log = recorded_log(context, log or Path("last"))
    if other is not None and not other.is_file():
        raise ValueError(f"{other}: there is no such log")
    place = recorded.ReplaySetup(world, scenario, rules)
    if check:
        trust = recorded.TrustedKeys(frozenset(key or ()), unsigned, witness)
        recorded.show_verified(log, trust, None if chain_only else place, json)
    elif again:
        recorded.show_again(log, place, json)
    if other is None:
        if not (check or again):
            recorded.play(log, world, settings_of(context, "mouse"))
    elif not screen:
        recorded.compare_logs(log, other, json)
    elif not (check or again):
        recorded.show_compared(log, other, world, settings_of(context, "mouse"))
