"""`pa-console replay`: verify a session log, or play it back."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from pa_console.cli.output import BAD_INPUT, FAILED, JsonOption, errors, out, print_json
from pa_console.resources import find_data
from pa_console.schema.document import DocumentError
from pa_console.schema.event import SessionStarted
from pa_console.session.chain import LogError
from pa_console.session.head import head_path
from pa_console.session.reader import line_of
from pa_console.session.verify import verify
from pa_console.signing import is_fingerprint, known_keys


def replay(
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
    no_mouse: Annotated[bool, typer.Option(help="Leave the mouse to the terminal.")] = False,
    json: JsonOption = False,
) -> None:
    """Play LOG back in the console, verify it, or run it again and compare.

    --verify leaves with 0 only when every line is vouched for by a known key, with 2 when the log
    or its head was damaged, and with 1 when nothing is wrong but not everything is signed.
    """
    if not log.is_file():
        raise ValueError(f"{log}: there is no such log")
    if check:
        _verify(log, frozenset(key or ()), unsigned, json)
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
    site = load_site(_world_of(started, world), started.rules, unsigned=True)
    if (site.world_sha256, site.rulebook.sha256) != (started.world_sha256, started.rules_sha256):
        errors.print("note: the world or the rules have changed since this session", style="yellow")
    retriever = Retriever(site.rulebook.rules)
    ConsoleApp(site.world, None, site.rulebook, retriever, player=player).run(mouse=mouse)


def _resimulate(log: Path, world: str | None, scenario: str | None, json: bool) -> None:
    """Run a recorded session again in a fresh simulation; compare telemetry and rehearsals.

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


def _world_of(started: SessionStarted, given: str | None) -> str:
    """Return where the session's world is; raises ValueError when it is not installed here."""
    name = given or started.world
    if not find_data("worlds", name, "world.yaml").is_file():
        raise ValueError(
            f"the world {name!r} of this session is not installed here; give its file with --world"
        )
    return name
