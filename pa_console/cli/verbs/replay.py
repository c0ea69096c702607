"""`pa-console replay`: verify a session log, or play it back."""

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
            help="A session log (JSONL), or a session of 'pa-console sessions' by its id.",
            autocompletion=completion.sessions,
        ),
    ] = None,
    last: Annotated[
        bool, typer.Option("--last", help="The session that was recorded last.")
    ] = False,
    check: Annotated[
        bool,
        typer.Option(
            "--verify",
            help="Check the hash chain, the signatures and the signed head, name the first bad "
            "line and what was done to it; then run the session again.",
        ),
    ] = False,
    chain_only: Annotated[
        bool, typer.Option("--chain-only", help="With --verify: do not run the session again.")
    ] = False,
    key: Annotated[
        list[str] | None,
        typer.Option(
            help="With --verify: the fingerprint of a key that may have signed, besides this "
            "machine's; repeatable."
        ),
    ] = None,
    unsigned: Annotated[
        bool, typer.Option("--unsigned", help="With --verify: accept a log without signatures.")
    ] = False,
    witness: Annotated[
        Path | None,
        typer.Option(
            help="With --verify: the file of a witness; names the first head that it has seen and "
            "the log no longer has."
        ),
    ] = None,
    again: Annotated[
        bool,
        typer.Option(
            "--resimulate",
            help="Only run the session again: its telemetry, the rehearsals of its plans and what "
            "the rules say of them must come out equal; name what does not.",
        ),
    ] = False,
    world: SessionWorldOption = None,
    scenario: Annotated[
        str | None, typer.Option("--scenario", help="The session's situation, when it is a file.")
    ] = None,
    rules: SessionRulesOption = None,
    other: Annotated[
        Path | None,
        typer.Option(
            "--compare",
            metavar="LOG",
            help="Find the first event in which LOG tells something else, and what differs; leaves "
            "with 0 when both tell the same and with 1 when not.",
        ),
    ] = None,
    screen: Annotated[
        bool, typer.Option("--screen", help="With --compare: show both at that point, on a screen.")
    ] = False,
    mouse: MouseOption = True,  # noqa: ARG001 - one of the settings
    json: JsonOption = False,
) -> None:
    """Play LOG back in the console, verify it, run it again, or compare it with another one.

    --verify leaves with 0 only when every line is vouched for by a known key and the session came
    out equal, with 2 when the log or its head was damaged, and with 1 when it is sound but not all
    signed, or could not be run again to the same end.
    """
    if last == (log is not None):
        raise ValueError(
            "give a session log, or --last for the session that was recorded last. "
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
