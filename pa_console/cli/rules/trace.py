"""`pa-console rules trace`: from a rule to every mission in which it did something."""

from collections.abc import Iterable
from typing import Annotated

import typer

from pa_console.cli.export.source import ExportBar
from pa_console.cli.output import BAD_INPUT, FAILED, JsonOption, errors, out, print_json
from pa_console.cli.rules.session_logs import LogsArgument, SessionEvents, find_logs
from pa_console.schema.document import DocumentError
from pa_console.views.rule_trail import BREAKING, RuleDeed, Trail, trail_of

_COUNTED: tuple[tuple[str, tuple[RuleDeed, ...]], ...] = (
    ("retrieved", ("retrieved",)),
    ("decided", ("decided", "broken", "refused")),
    ("broken", BREAKING),
    ("prescribed", ("prescribed",)),
)


def trace(
    rule: Annotated[str, typer.Argument(metavar="RULE_ID", help="For example ROE-07.")],
    logs: LogsArgument,
    every: Annotated[bool, typer.Option("--all", help="Show where it did not apply, too.")] = False,
    json: JsonOption = False,
) -> None:
    """List every mission in which a rule was retrieved, decided a plan, or was broken.

    Each line says the event, the simulation's tick, the attempt, and the words. Exit code 1 when
    no session knows the rule, 2 when a log cannot be read.
    """
    found: dict[str, list[Trail]] = {}
    unread: dict[str, str] = {}
    places = find_logs(logs)
    with ExportBar("reading sessions", len(places)) as bar:
        for log in places:
            try:
                events = SessionEvents(log)
                found[str(log)] = trail_of(rule, events)
                if events.problem:
                    unread[str(log)] = events.problem
            except DocumentError as error:
                unread[str(log)] = str(error)
            bar.advance(1)
    if json:
        print_json({"rule": rule, "sessions": found, "unread": unread})
    else:
        _print(rule, found, every)
    for log, problem in unread.items():
        errors.print(f"{log}: not read to its end: {problem}", markup=False, soft_wrap=True)
    if unread:
        raise typer.Exit(BAD_INPUT)
    if not any(found.values()):
        raise typer.Exit(FAILED)


def _print(rule: str, found: dict[str, list[Trail]], every: bool) -> None:
    for log, trails in found.items():
        for trail in trails:
            shown = [e for e in trail.entries if every or e.did != "not applicable"]
            if not shown:
                continue
            _line(f"{log}: {trail.session} {trail.mission.id}  {trail.mission.text}")
            for entry in shown:
                attempt = f" attempt {entry.attempt}" if entry.attempt else ""
                words = f": {entry.words}" if entry.words else ""
                _line(f"  event {entry.event}, tick {entry.tick}{attempt}: {entry.did}{words}")
    every_trail = [trail for trails in found.values() for trail in trails]
    parts = [f"{name} in {_count(every_trail, what)}" for name, what in _COUNTED]
    searched = f"sessions searched: {len(found)}"
    if every_trail:
        _line(f"{rule}, missions: {', '.join(parts)}; {searched}")
    else:
        _line(f"{rule}: no mission had to do with it; {searched}")


def _count(trails: Iterable[Trail], what: tuple[RuleDeed, ...]) -> int:
    return sum(trail.did(*what) for trail in trails)


def _line(text: str) -> None:
    out.print(text, markup=False, soft_wrap=True)
