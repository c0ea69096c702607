"""Recorded sessions: showing them on the console, verifying, simulating again, and comparing."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from rich.text import Text

from pa_console.cli.progress_bars import TransientBar
from pa_console.end_signals import end_signals, exit_code_of
from pa_console.evaluation.changed_decisions import SessionEffect
from pa_console.evaluation.recorded_decisions import decided_again
from pa_console.evaluation.twin import Resimulation, resimulate
from pa_console.policy.retriever import Retriever
from pa_console.resources import find_data
from pa_console.schema.document import DocumentError
from pa_console.schema.events.event import Event, SessionStarted
from pa_console.schema.incident import Scenario
from pa_console.schema.text import count
from pa_console.schema.world import World
from pa_console.session.log.chain import LogError, line_of
from pa_console.session.log.session_index import check_index, index_path
from pa_console.session.log.signed_head import WitnessResult, check_witness, head_path
from pa_console.session.log.verification import VerifyResult, verify
from pa_console.session.recording import Player, Recording
from pa_console.settings.sources import LoadedSettings
from pa_console.signing import is_fingerprint, known_keys
from pa_console.sim.worlds.scenario_file import open_scenario
from pa_console.sim.worlds.world_file import open_world
from pa_console.station.assembly import SessionSites, Site, load_site
from pa_console.terminal.output import (
    BAD_INPUT,
    FAILED,
    errors,
    out,
    print_json,
    require_keys,
)
from pa_console.tui.recordings import index_folder
from pa_console.views.comparison import EventDifference, SessionComparison, compare_sessions
from pa_console.views.event_words import event_in_words, kind_in_words

if TYPE_CHECKING:
    from pa_console.tui.app import Opening

CHANGES = 12
"""The largest number of differences that are printed; --json shows all."""


def read_recording(log: Path) -> Recording:
    """Return `log`, opened for a replay; raises LogError if not even one line of it is valid."""
    with TransientBar(f"reading {log.name}", of_bytes=True) as bar:
        return Recording.read(log, bar.show, cache=index_folder())


def play(log: Path, world: str | None, settings: LoadedSettings) -> None:
    """Show the recording on the console, with the world and the rules of the session."""
    recording = read_recording(log)
    _run_console(_site_of(recording, log, world), recording, settings)


def _run_console(
    site: Site, recording: Recording, settings: LoadedSettings, opening: "Opening | None" = None
) -> None:
    """Show the recording on the console until the operator leaves; `opening` opens more screens."""
    from pa_console.tui.app import ConsoleApp  # noqa: PLC0415 - only if it is shown

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


def _site_of(recording: Recording, log: Path, world: str | None) -> Site:
    """Return the world and the rules of a session, and report if they have changed since.

    Raises LogError if the file is not a session log, and ValueError if the world is missing here.
    """
    started = recording.started
    site = load_site(world_of(started, world, log), started.rules, unsigned=True)
    if (site.world_sha256, site.rulebook.sha256) != (started.world_sha256, started.rules_sha256):
        errors.print("note: the world or the rules have changed since this session", style="yellow")
    return site


def world_of(started: SessionStarted, given: str | None, log: Path) -> str:
    """Return the name or path of a session's world: given, installed, or stored beside the log.

    Raises ValueError if there is no such world.
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


@dataclass(frozen=True)
class ReplaySetup:
    """The world, scenario and rules of a session, if the original ones are not installed here."""

    world: str | None = None
    scenario: str | None = None
    rules: str | None = None


@dataclass(frozen=True)
class Again:
    """The result of simulating a session again; `line` is the log's line with the first difference.

    `decided` is None if the rules of the session are missing here.
    """

    twin: Resimulation
    line: int | None
    decided: SessionEffect | None
    problem: LogError | None

    @property
    def equal(self) -> bool:
        """True if everything is equal to the record."""
        return self.twin.equal and self.decided is not None and not self.decided.flips

    def document(self) -> dict[str, Any]:
        """Return the result in the form for `--json`."""
        decided = None if self.decided is None else asdict(self.decided)
        return {**asdict(self.twin), "first_line": self.line, "decided": decided}


def _run_again(log: Path, place: ReplaySetup) -> Again:
    """Simulate the session of `log` again with its recorded decisions and answers.

    Raises ValueError (or DocumentError) if its world or scenario is missing here, and LogError if
    the file is not a session log.
    """
    recording = read_recording(log)
    started = recording.started
    sites = SessionSites(
        worlds=[place.world] if place.world else (), rules=[place.rules] if place.rules else ()
    )
    world, path = _original_world(sites, started, place.world, log)
    situation = _situation(world, path, place.scenario, started)
    with errors.status(f"simulating {count(len(recording), 'event')} again"):
        twin = resimulate(_events(recording), world, situation)
        rules = sites.rules_of(started)
        decided = None if rules is None else decided_again(_events(recording), world, rules)
    line = line_of(log, twin.first_event) if twin.first_event is not None else None
    return Again(twin, line, decided, recording.problem)


def show_again(log: Path, place: ReplaySetup, json: bool) -> None:
    """Simulate the session of `log` again, and print the result; a difference exits with code 1.

    If the log cannot be read to its end, the session is compared up to that place, and then the
    LogError is raised.
    """
    again = _run_again(log, place)
    if json:
        print_json(again.document())
    else:
        _print_again(log, again)
    if not again.equal:
        raise typer.Exit(FAILED)
    if again.problem is not None:
        raise again.problem


def _print_again(log: Path, again: Again) -> None:
    """Print which parts of a session are equal to the record, and which are not."""
    twin, decided = again.twin, again.decided
    if twin.equal:
        out.print_line(
            f"{log}: {count(twin.pictures, 'picture')} and {count(twin.rehearsals, 'rehearsal')} "
            f"of plans are equal; SHA-256 {twin.repeated_sha256}"
        )
    else:
        at = f"{log}:{again.line}" if again.line is not None else str(log)
        errors.print_line(
            f"{at}: {twin.different} of {twin.pictures} pictures and "
            f"{twin.different_rehearsals} of {twin.rehearsals} rehearsals differ, first at "
            f"{twin.first_difference}"
        )
    if decided is None:
        errors.print_line(
            f"{log}: the plans were not checked again, because the rules of this session are not "
            "installed here, or they have changed; give their file with --rules"
        )
        return
    for flip in decided.flips:
        where = f"{flip.mission} attempt {flip.attempt}" if flip.attempt else flip.mission
        rules = ", ".join(flip.rules)
        errors.print_line(
            f"{log}: {where}: {flip.kind} {rules}: recorded {flip.was}, again {flip.now}"
        )
    if not decided.flips:
        left = f"; {len(decided.gaps)} could not be checked again" if decided.gaps else ""
        out.print_line(
            f"{log}: {count(decided.compared, 'finding')} on {count(decided.plans, 'plan')} of "
            f"{count(decided.missions, 'mission')} checked again, all equal{left}"
        )


def _original_world(
    sites: SessionSites, started: SessionStarted, given: str | None, log: Path
) -> tuple[World, Path]:
    """Return the session's world, found by its hash, or the world given in its place."""
    path = sites.world_file(started, log)
    if path is None and given is not None:
        errors.print_line(f"note: {given} differs from the world of this session")
        return open_world(given)
    world = sites.world_of(started, log)
    assert path is not None
    return world, path


def _situation(
    world: World, path: Path, given: str | None, started: SessionStarted
) -> Scenario | None:
    """Return the session's scenario, if there was one, or the scenario given in its place.

    Raises ValueError if the scenario's hash differs from the one in the log.
    """
    played = given or started.scenario
    if not played:
        return None
    try:
        loaded = open_scenario(world, path, played)
    except DocumentError as error:
        if given is not None:
            raise
        raise ValueError(f"{error}; give the session's own file with --scenario") from error
    pinned = started.scenario_sha256
    if pinned and loaded.sha256 != pinned:
        if given is None:
            raise ValueError(
                f"the scenario {played!r} of this session is not installed here, or it has "
                f"changed (SHA-256 {pinned[:12]}); give its file with --scenario"
            )
        errors.print_line(f"note: {given} differs from the scenario of this session")
    return loaded.scenario


def _events(recording: Recording) -> Iterator[Event]:
    return (recording[index] for index in range(len(recording)))


def compare_logs(first: Path, second: Path, json: bool) -> None:
    """Print the differences between two logs; if there are any, exit with FAILED.

    If a log cannot be read to its end and there is no difference up to that place, its LogError is
    raised.
    """
    a, b = read_recording(first), read_recording(second)
    with errors.status("comparing") as status:

        def going_on(done: int, total: int) -> None:
            status.update(f"comparing, {done} of {count(total, 'event')}")

        comparison = compare_sessions(a, b, going_on)
    problem = a.problem or b.problem
    if json:
        print_json({"same": comparison.same and not problem, **asdict(comparison)})
    elif comparison.same and not problem:
        out.print(f"no differences in {count(len(a), 'event')}")
    else:
        _print(comparison, (a, b), (first, second))
    if problem is not None:
        errors.print_line(f"note: {problem}", style="yellow")
    if not comparison.same:
        raise typer.Exit(FAILED)
    if problem is not None:
        raise problem


def show_compared(first: Path, second: Path, world: str | None, settings: LoadedSettings) -> None:
    """Show the first log on the console, with the comparison of both logs on top."""
    from pa_console.tui.app import comparison  # noqa: PLC0415 - only if it is shown
    from pa_console.tui.recordings import KnownWorld, OpenedLog, open_compared  # noqa: PLC0415

    recording = read_recording(first)
    site = _site_of(recording, first, world)
    rules = {rule.id: rule for rule in site.rulebook.rules}
    own_world = KnownWorld(site.world, site.world_sha256)
    first_log = OpenedLog(first.name, recording, site.world, rules)
    second_log = open_compared(second, own_world)
    _run_console(site, recording, settings, comparison(first_log, second_log))


def _print(
    comparison: SessionComparison, both: tuple[Recording, Recording], names: tuple[Path, Path]
) -> None:
    for letter, name, recording in zip("AB", names, both, strict=True):
        out.print_line(f"{letter}  {name}: {count(len(recording), 'event')}")
    if comparison.started:
        out.print("\ndifferent starts", style="bold")
        for change in comparison.started:
            out.print_line(f"  {change.path}: {change.a} | {change.b}")
    if comparison.first is None:
        out.print("\nno difference in any event")
    else:
        _print_difference("first difference", comparison.first, both)
    if comparison.beyond is not None:
        _print_difference("first difference except telemetry and ticks", comparison.beyond, both)


def _print_difference(
    title: str, difference: EventDifference, both: tuple[Recording, Recording]
) -> None:
    out.print(f"\n{title}", style="bold")
    for letter, recording, at in zip("AB", both, (difference.a, difference.b), strict=True):
        if at >= len(recording):
            out.print(f"  {letter}  ends after {count(len(recording), 'event')}")
            continue
        event = recording[at]
        words = f"{event.mission or ''} {kind_in_words(event.data.kind)}".strip()
        content = event_in_words(event.data)
        when = f"{recording.timeline.seconds[at]:.1f} s, tick {event.tick}"
        line = Text(f"  {letter}  event {at + 1}, {when}: ")
        line.append(words, "bold").append(f" {content[:160]}")
        out.print_line(line)
    for change in difference.changes[:CHANGES]:
        out.print_line(f"     {change.path}: {_short(change.a)} | {_short(change.b)}")
    if (more := len(difference.changes) - CHANGES) > 0:
        out.print(f"     and {count(more, 'more value')}; show all with --json")


def _short(text: str) -> str:
    flat = " ".join(text.split())
    return flat if len(flat) <= 160 else f"{flat[:160]}…"


@dataclass(frozen=True)
class TrustedKeys:
    """The fingerprints of trusted keys in addition to this machine's keys.

    If `unsigned` is True, a log without a signature is accepted as well. `witness` is the file with
    the heads that a witness has received.
    """

    keys: frozenset[str] = frozenset()
    unsigned: bool = False
    witness: Path | None = None

    def accepts(self, result: VerifyResult) -> bool:
        """Return whether a log is signed with a trusted key, or is accepted unsigned."""
        unsigned = self.unsigned and result.ok and result.standing == "not signed"
        return result.intact or unsigned


def show_verified(log: Path, trust: TrustedKeys, place: ReplaySetup | None, json: bool) -> None:
    """Print whether a log is sound; with `place`, simulate a sound log again.

    Exits with BAD_INPUT for damage, including damage that the index or the witness reveals. Exits
    with FAILED if a sound log is not signed with a trusted key, or if its simulation differs.
    Raises ValueError if a key is not a fingerprint.
    """
    for given in trust.keys:
        if not is_fingerprint(given):
            raise ValueError(f"--key {given}: give a fingerprint, SHA256: and 43 characters")
    own = known_keys()
    trusted = own | trust.keys
    result, index = verify(log, trusted), check_index(log.parent, trusted)
    seen = check_witness(log, result.session, trust.witness, trusted) if trust.witness else None
    lost = index.of(log)
    again, problem = None, ""
    if place is not None and result.ok:
        try:
            again = _run_again(log, place)
        except ValueError as error:
            problem = str(error)
    if json:
        run = {"problem": problem} if again is None else again.document()
        verdict = {"intact": result.intact and not lost, **asdict(result), "again": run}
        print_json({**verdict, "index": index.all_problems, "witness": seen})
    else:
        _print_result(log, result, own)
        if again is not None:
            _print_again(log, again)
        if problem:
            errors.print_line(
                f"{log}: not simulated again: {problem}; to verify the log only, use --chain-only"
            )
        for index_problem in index.all_problems:
            errors.print_line(f"{index_path(log.parent)}: {index_problem}")
        if seen is not None:
            _print_statement(log, trust.witness, seen)
    if lost or (seen is not None and seen.line is not None):
        raise typer.Exit(BAD_INPUT)
    if seen is not None and not seen.ok:
        raise typer.Exit(FAILED if result.ok else BAD_INPUT)
    if not trust.accepts(result) or problem or (again is not None and not again.equal):
        raise typer.Exit(FAILED if result.ok else BAD_INPUT)


def _print_result(log: Path, result: VerifyResult, own: frozenset[str]) -> None:
    if not result.ok:
        place = f"{log}:{result.first_bad_line}" if result.first_bad_line else str(head_path(log))
        place += f"-{result.last_bad_line}" if result.last_bad_line else ""
        errors.print_line(f"{place}: {result.damage}: {result.problem}")
        return
    by = f"signed by {result.key}{' (the key of this machine)' * (result.key in own)}"
    standing = {
        "signed": f"{by}.",
        "open": f"{by} only up to line {result.vouched}." if result.key else "not signed yet.",
        "not signed": "not signed, so it may have been replaced by another log.",
    }[result.standing]
    line = f"{log}: {count(result.lines, 'line')}, chain intact, {standing}"
    line += f" {result.note[:1].upper()}{result.note[1:]}." if result.note else ""
    out.print_line(line)


def _print_statement(log: Path, witness: Path | None, seen: WitnessResult) -> None:
    """Print whether the log has all heads that its witness has received."""
    if not seen.ok:
        place = f"{witness}:{seen.line}" if seen.line is not None else f"{witness}"
        errors.print_line(f"{place}: {seen.problem}")
        return
    heads = f"{log}: has all {count(seen.heads, 'head')} that {witness} received"
    out.print_line(f"{heads}, the last after record {seen.records}")
