"""`pa-console sessions`: the recorded sessions on this machine."""

from pathlib import Path
from shlex import quote
from typing import Annotated, Any

import typer
from rich.table import Table
from rich.text import Text

from pa_console.cli import completion
from pa_console.cli.options import JsonOption
from pa_console.cli.settings_defaults import settings_of
from pa_console.schema.text import clock_text, count, visible
from pa_console.session.log.writer import default_folder
from pa_console.session.past_sessions import (
    SessionSummary,
    Soundness,
    find_session,
    newest_logs,
    past_sessions,
    soundness,
    summarise,
)
from pa_console.terminal.mission import COLOURS
from pa_console.terminal.output import errors, out, print_json
from pa_console.views.status_words import outcomes_in_words, status_of

MOST = 20
"""The default number of sessions in the list."""


def sessions(
    context: typer.Context,
    session: Annotated[
        str | None,
        typer.Argument(
            help="Session to show: an id or its beginning, 'last', or a log file. Default: list.",
            autocompletion=completion.sessions,
        ),
    ] = None,
    most: Annotated[
        int, typer.Option("--most", min=1, help="List at most this many, the newest first.")
    ] = MOST,
    everything: Annotated[bool, typer.Option("--all", help="List every session.")] = False,
    json: JsonOption = False,
) -> None:
    """List the recorded sessions, or show one: missions, outcomes and state of the log."""
    folder = settings_of(context).values.logs or default_folder()
    if session is not None:
        log = find_session(folder, session)
        _show(log, log.stem if log in newest_logs(folder) else quote(str(log)), json)
        return
    with errors.status("reading the session logs"):
        summaries = past_sessions(folder, None if everything else most)
        sound = [soundness(summary.log) for summary in summaries]
    if json:
        print_json(list(map(_document, summaries, sound)))
        return
    if not summaries:
        out.print_line(f"no recorded sessions in {folder}")
        return
    out.print(_table(summaries, sound))
    more = len(newest_logs(folder)) - len(summaries)
    if more > 0 and not everything:
        out.print(f"{count(more, 'more log')}; list them with --all", style="dim")


def _table(summaries: list[SessionSummary], sound: list[Soundness]) -> Table:
    table = Table(box=None, pad_edge=False, expand=True)
    table.add_column("Session", no_wrap=True, min_width=20)
    table.add_column("Title", ratio=1, overflow="fold")
    table.add_column("Missions", min_width=12, max_width=20)
    table.add_column("Length", justify="right", no_wrap=True, min_width=6)
    table.add_column("Log", no_wrap=True, min_width=12)
    for summary, standing in zip(summaries, sound, strict=True):
        mark = status_of("log", standing.standing)
        table.add_row(
            summary.log.stem,
            _title(summary),
            Text(outcomes_in_words(summary.outcomes)),
            clock_text(summary.length_s),
            Text(mark.text, COLOURS[mark.tone]),
        )
    return table


def _title(summary: SessionSummary) -> Text:
    """Return a session's title, and its scenario if that differs from the title."""
    title = Text(visible(summary.title))
    if summary.scenario and summary.scenario != summary.title:
        title.append(f" ({visible(summary.scenario)})", "dim")
    return title


def _show(log: Path, reference: str, json: bool) -> None:
    """Print a session: place, time, missions and log; other verbs find it by `reference`."""
    with errors.status("reading the session log"):
        summary, standing = summarise(log), soundness(log)
    if json:
        print_json(_document(summary, standing))
        return
    mark = status_of("log", standing.standing)
    never = "not yet" if standing.standing == "running" else "no, the log was not closed"
    rows = (
        ("Session", summary.session),
        ("Title", summary.title),
        ("Started", summary.local_start),
        ("Length", clock_text(summary.length_s)),
        ("World", f"{summary.world}, rules {summary.rules}, seed {summary.seed}"),
        ("Scenario", summary.scenario or "none"),
        ("Model", summary.model),
        ("Ended", never if summary.ending == "open" else summary.reason),
        ("Log", f"{mark.text}: {standing.detail}" if standing.detail else mark.text),
        ("File", str(log)),
    )
    table = Table(box=None, show_header=False, pad_edge=False)
    for name, text in rows:
        table.add_row(Text(name, "bold"), Text(visible(text)))
    out.print(table)
    out.print(f"\n{count(len(summary.missions), 'mission')}", style="bold")
    missions = Table(box=None, show_header=False, pad_edge=False)
    for mission in summary.missions:
        outcome = status_of("mission", mission.status or "open")
        text = Text(visible(f"{mission.origin}{mission.said}"))
        if mission.reason:
            text.append(f"\n{visible(mission.reason)}", "dim")
        missions.add_row(mission.id, Text(outcome.text, COLOURS[outcome.tone]), text)
    if summary.missions:
        out.print(missions)
    out.print_line(f"\nReplay it with: pa-console replay {reference}")


def _document(summary: SessionSummary, standing: Soundness) -> dict[str, Any]:
    """Return all facts about a session for `--json`."""
    counted = {"title": summary.title, "outcomes": summary.outcomes}
    length = {"length_s": round(summary.length_s, 3)}
    return {**vars(summary), **counted, **length, **vars(standing)}
