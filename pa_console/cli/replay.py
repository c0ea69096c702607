"""`pa-console replay`: verify a session log, or play it back."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from pa_console.cli.chosen import settings_of
from pa_console.cli.output import BAD_INPUT, FAILED, JsonOption, errors, out, print_json
from pa_console.schema.document import DocumentError
from pa_console.session.head import head_path
from pa_console.session.reader import line_of
from pa_console.session.verify import verify
from pa_console.settings.sources import Loaded
from pa_console.signing import is_fingerprint, known_keys


def replay(
    context: typer.Context,
    log: Annotated[Path, typer.Argument(help="A session log (JSONL).")],
    check: Annotated[
        bool,
        typer.Option(
            "--verify",
            help="Check the hash chain, the signatures and the signed head; name the first bad "
            "line and what was done to it.",
        ),
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
    again: Annotated[
        bool,
        typer.Option(
            "--resimulate",
            help="Run the session again: its telemetry and the rehearsals of its plans must come "
            "out equal; name the first line that does not.",
        ),
    ] = False,
    world: Annotated[
        str | None, typer.Option("--world", help="The session's world, when it is a file.")
    ] = None,
    scenario: Annotated[
        str | None, typer.Option("--scenario", help="The session's situation, when it is a file.")
    ] = None,
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
    mouse: Annotated[
        bool,
        typer.Option("--mouse/--no-mouse", help="Take the mouse, or leave it to the terminal."),
    ] = True,
    json: JsonOption = False,
) -> None:
    """Play LOG back in the console, verify it, run it again, or compare it with another one.

    --verify leaves with 0 only when every line is vouched for by a known key, with 2 when the log
    or its head was damaged, and with 1 when nothing is wrong but not everything is signed.
    """
    for given in (log, other):
        if given is not None and not given.is_file():
            raise ValueError(f"{given}: there is no such log")
    if check:
        _verify(log, frozenset(key or ()), unsigned, json)
    if again:
        _resimulate(log, world, scenario, json)
    printed = other is not None and not screen
    if other is not None and printed:
        from pa_console.cli.replay_compare import compare_logs  # noqa: PLC0415 - only when asked

        compare_logs(log, other, json)
    if not (check or again or printed):
        _show(log, other, world, settings_of(context, mouse=mouse))


def _show(log: Path, other: Path | None, world: str | None, settings: Loaded) -> None:
    """Open the console on a recording, or on two at the point where they differ."""
    from pa_console.cli.replay_compare import show_compared  # noqa: PLC0415 - only when shown
    from pa_console.cli.replay_play import play  # noqa: PLC0415

    if other is not None:
        show_compared(log, other, world, settings)
    else:
        play(log, world, settings)


def _resimulate(log: Path, world: str | None, scenario: str | None, json: bool) -> None:
    """Run a recorded session again in a fresh simulation; compare telemetry and rehearsals.

    A log that cannot be read to its end is compared up to there, and then raises its LogError.
    """
    from pa_console.cli.read_bar import read_recording  # noqa: PLC0415 - only when it is asked for
    from pa_console.cli.replay_play import started_of, world_of  # noqa: PLC0415
    from pa_console.evaluation.twin import resimulate  # noqa: PLC0415
    from pa_console.orchestrator.compose import open_scenario, open_world  # noqa: PLC0415

    recording = read_recording(log)
    started = started_of(recording, log)
    place, path = open_world(world_of(started, world))
    played = scenario or started.scenario
    try:
        situation = open_scenario(place, path, played).scenario if played else None
    except DocumentError as error:
        if scenario is not None:
            raise
        raise ValueError(f"{error}; give the session's own file with --scenario") from error
    with errors.status(f"running {len(recording)} events again"):
        twin = resimulate((recording[index] for index in range(len(recording))), place, situation)
    line = line_of(log, twin.first_event) if twin.first_event is not None else None
    if json:
        print_json({**asdict(twin), "first_line": line})
    elif twin.equal:
        out.print(
            f"{log}: {twin.pictures} pictures, all equal, and {twin.rehearsals} "
            f"rehearsal{'s' * (twin.rehearsals != 1)} of plans; SHA-256 {twin.repeated_sha256}",
            markup=False,
            soft_wrap=True,
        )
    else:
        place = f"{log}:{line}" if line is not None else str(log)
        errors.print(
            f"{place}: {twin.different} of {twin.pictures} pictures and "
            f"{twin.different_rehearsals} of {twin.rehearsals} rehearsals differ, first at "
            f"{twin.first_difference}",
            markup=False,
            soft_wrap=True,
        )
    if not twin.equal:
        raise typer.Exit(1)
    if recording.problem is not None:
        raise recording.problem


def _verify(log: Path, keys: frozenset[str], unsigned: bool, json: bool) -> None:
    """Say how sound a log is; leaves with FAILED for one that is sound but not vouched for."""
    for given in keys:
        if not is_fingerprint(given):
            raise ValueError(f"--key {given}: a fingerprint is SHA256: and 43 characters")
    own = known_keys()
    result = verify(log, own | keys)
    accepted = result.intact or (unsigned and result.ok and result.standing == "not signed")
    if json:
        print_json({"intact": result.intact, **asdict(result)})
    elif result.ok:
        by = f"signed by {result.key}{' (the key of this machine)' * (result.key in own)}"
        standing = {
            "signed": f"{by}.",
            "open": f"{by} up to line {result.vouched} only." if result.key else "not signed yet.",
            "not signed": "not signed: nothing shows that it was not written anew.",
        }[result.standing]
        told = f"{log}: {result.lines} lines, chain intact, {standing}"
        told += f" {result.note[:1].upper()}{result.note[1:]}." if result.note else ""
        out.print(told, markup=False, soft_wrap=True)
    else:
        place = f"{log}:{result.first_bad_line}" if result.first_bad_line else str(head_path(log))
        place += f"-{result.last_bad_line}" if result.last_bad_line else ""
        errors.print(f"{place}: {result.damage}: {result.problem}", markup=False, soft_wrap=True)
    if not accepted:
        raise typer.Exit(FAILED if result.ok else BAD_INPUT)
