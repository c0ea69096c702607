"""`pa-console replay A --compare B`: the first point where two sessions differ, and how."""

from dataclasses import asdict
from functools import partial
from pathlib import Path

import typer
from rich.text import Text

from pa_console.cli.output import FAILED, errors, out, print_json
from pa_console.cli.read_bar import read_recording
from pa_console.cli.replay_play import run_console, site_of
from pa_console.session.compare import Comparison, Difference, compare
from pa_console.session.event_words import event_in_words, kind_in_words
from pa_console.session.recording import Recording
from pa_console.settings.sources import Loaded
from pa_console.tui.words import count

CHANGES = 12
"""So many values that differ are printed; --json has all."""


def compare_logs(first: Path, second: Path, json: bool) -> None:
    """Print where the logs differ, if they do; leaves with FAILED then.

    Logs that are equal up to where one of them cannot be read raise its LogError.
    """
    a, b = read_recording(first), read_recording(second)
    with errors.status("comparing") as status:

        def going_on(done: int, total: int) -> None:
            status.update(f"comparing, {done} of {count(total, 'event')}")

        found = compare(a, b, going_on)
    problem = a.problem or b.problem
    if json:
        print_json({"same": found.same and not problem, **asdict(found)})
    elif found.same and not problem:
        out.print(f"the same: {count(len(a), 'event')}", markup=False)
    else:
        _print(found, (a, b), (first, second))
    if problem is not None:
        errors.print(f"note: {problem}", style="yellow", markup=False, soft_wrap=True)
    if not found.same:
        raise typer.Exit(FAILED)
    if problem is not None:
        raise problem


def show_compared(first: Path, second: Path, world: str | None, settings: Loaded) -> None:
    """Open the console on the first log, with both at the point of difference over it."""
    from pa_console.tui.comparing_app import ComparingApp  # noqa: PLC0415 - only when it is shown
    from pa_console.tui.recordings import KnownWorld, open_compared  # noqa: PLC0415
    from pa_console.tui.screens.compare import Side  # noqa: PLC0415

    recording = read_recording(first)
    site = site_of(recording, first, world)
    rules = {rule.id: rule for rule in site.rulebook.rules}
    known = KnownWorld(site.world, site.world_sha256)
    sides = (
        Side(first.name, recording, site.world, rules),
        Side.of(second.name, open_compared(second, known)),
    )
    run_console(partial(ComparingApp, sides), site, recording, settings)


def _print(found: Comparison, both: tuple[Recording, Recording], names: tuple[Path, Path]) -> None:
    for letter, name, recording in zip("AB", names, both, strict=True):
        out.print(
            f"{letter}  {name}: {count(len(recording), 'event')}", markup=False, soft_wrap=True
        )
    if found.started:
        out.print("\nstarted differently", style="bold")
        for change in found.started:
            out.print(f"  {change.path}: {change.a} | {change.b}", markup=False, soft_wrap=True)
    if found.first is None:
        out.print("\nevery event means the same in both")
    else:
        _print_difference("first difference", found.first, both)
    if found.beyond is not None:
        _print_difference("first difference beyond telemetry and ticks", found.beyond, both)


def _print_difference(title: str, found: Difference, both: tuple[Recording, Recording]) -> None:
    out.print(f"\n{title}", style="bold")
    for letter, recording, at in zip("AB", both, (found.a, found.b), strict=True):
        if at >= len(recording):
            out.print(f"  {letter}  ends after {count(len(recording), 'event')}")
            continue
        event = recording[at]
        words = f"{event.mission or ''} {kind_in_words(event.data.kind)}".strip()
        said = event_in_words(event.data)
        line = Text(
            f"  {letter}  event {at + 1}, {recording.offset(at):.1f} s, tick {event.tick}: "
        )
        line.append(words, "bold").append(f" {said[:160]}")
        out.print(line, soft_wrap=True)
    for change in found.changes[:CHANGES]:
        out.print(f"     {change.path}: {_short(change.a)} | {_short(change.b)}", markup=False,
                  soft_wrap=True)  # fmt: skip
    if len(found.changes) > CHANGES:
        out.print(f"     and {count(len(found.changes) - CHANGES, 'more value')}; --json has all")


def _short(text: str) -> str:
    flat = " ".join(text.split())
    return flat if len(flat) <= 160 else f"{flat[:160]}…"
