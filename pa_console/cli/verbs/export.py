"""`pa-console export`: a recorded session in another tool's format."""

import asyncio
import os
import re
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import Annotated

import typer

from pa_console.cli import completion
from pa_console.cli.options import SessionRulesOption, SessionWorldOption, with_field_options
from pa_console.cli.progress_bars import TransientBar
from pa_console.cli.sessions.log import recorded_log
from pa_console.export.markdown import mission_document
from pa_console.export.mcap_file import write_mcap
from pa_console.export.shift_report import session_document
from pa_console.export.source_log import (
    OpenedSession,
    choose_mission,
    open_session,
    rules_of,
    site_of,
    whole_file,
    whole_folder,
    world_of,
)
from pa_console.schema.events.event import MissionReceived
from pa_console.schema.text import count, visible
from pa_console.session.stills import stills_folder
from pa_console.terminal.output import errors, out, print_document

DEFAULT_KINDS = ("approval_requested", "decision_made", "plan_halted", "mission_finished")
LEAST, MOST = (40, 10), (400, 200)
"""The smallest and the largest screen, in columns and rows."""

app = typer.Typer(
    help="Export a recorded session as Markdown, MCAP, SVG or asciinema cast.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


LogArgument = Annotated[
    Path,
    typer.Argument(
        help="Session: a log file (JSONL), an id from 'pa-console sessions', or 'last'.",
        autocompletion=completion.sessions,
    ),
]


def opened(context: typer.Context, log: Path) -> OpenedSession:
    """Return the session of `log`; report on stderr if the log cannot be read to its end."""
    log = recorded_log(context, log)
    with errors.status(f"reading {log.name}"):
        session = open_session(log)
    if session.recording.problem is not None:
        errors.print_line(
            f"note: only the log before this line is exported: {session.recording.problem}",
            style="yellow",
        )
    return session


def written(target: Path, content: str) -> None:
    """Print the path of the export, and its content in words."""
    out.print_line(f"{target}: {content}")


@dataclass(frozen=True)
class FilmOptions:
    """The options of every export that shows the replayed console."""

    mission: Annotated[
        str | None, typer.Option(help="Export only this mission, from its arrival to its end.")
    ] = None
    first: Annotated[
        float, typer.Option("--from", min=0.0, help="Begin at this second of the session.")
    ] = 0.0
    until: Annotated[
        float | None, typer.Option(min=0.0, help="End at this second of the session.")
    ] = None
    size: Annotated[str, typer.Option(metavar="COLUMNSxROWS", help="Size of the screen.")] = (
        "120x36"
    )
    world: SessionWorldOption = None
    rules: SessionRulesOption = None


@app.command("svg")
@with_field_options
def svg(
    context: typer.Context,
    log: LogArgument,
    target: Annotated[Path, typer.Option("--out", "-o", help="Folder to write.")],
    at: Annotated[
        list[str] | None,
        typer.Option(
            help="Take a screenshot after each event of this kind. Repeatable. Default: "
            + ", ".join(DEFAULT_KINDS)
        ),
    ] = None,
    every: Annotated[
        float | None, typer.Option(min=0.1, help="Seconds between screenshots, instead of --at.")
    ] = None,
    *,
    film: FilmOptions,
) -> None:
    """Write numbered SVG screenshots of the replayed console: 0001-approval_requested.svg, ..."""
    from pa_console.export.screen_files import (  # noqa: PLC0415 - the screens load slowly
        KINDS,
        ReplayedScreen,
        film_replay,
        shots_at,
        shots_every,
        take,
    )
    from pa_console.session.recording import Player  # noqa: PLC0415

    kinds = [kind for kind in KINDS if kind != "telemetry"]
    for kind in at or ():
        if kind not in kinds:
            raise ValueError(
                f"--at {kind}: unknown kind of event; the kinds are: {', '.join(kinds)}"
            )
    if at and every is not None:
        raise ValueError("give only one of --at and --every")
    screen = size_of(film.size)
    session = opened(context, log)
    span = span_of(session, film)
    shots = (
        shots_every(every, *span)
        if every is not None
        else shots_at(session.recording, at or DEFAULT_KINDS, *span)
    )
    if not shots:
        raise ValueError(f"{log}: no event of these kinds; choose another kind, or use --every")
    site = site_of(session.started, film.world, film.rules)
    player = Player(session.recording)
    with TransientBar("filming", len(shots)) as bar, whole_folder(target) as folder:

        async def direct(made: ReplayedScreen) -> None:
            await take(made, shots, folder, session.started.session, bar.advance)

        asyncio.run(film_replay(site, player, screen, direct))
    written(target, f"{count(len(shots), 'screenshot')} of {screen[0]}x{screen[1]}")


@app.command("cast")
@with_field_options
def cast(
    context: typer.Context,
    log: LogArgument,
    target: Annotated[Path, typer.Option("--out", "-o", help="The file to write.")],
    speed: Annotated[
        float, typer.Option(min=0.01, max=1000.0, help="Recorded seconds per second.")
    ] = 4.0,
    fps: Annotated[
        float, typer.Option(min=0.1, max=30.0, help="Maximum number of frames per second.")
    ] = 4.0,
    *,
    film: FilmOptions,
) -> None:
    """Write the replay as an asciinema cast (asciicast v2), with a marker for every mission.

    Play it with: asciinema play FILE
    """
    from pa_console.export.screen_files import CastWriter, ReplayedScreen, film_replay, positions  # noqa: PLC0415 - loads the screens
    from pa_console.session.recording import Player  # noqa: PLC0415

    screen = size_of(film.size)
    session = opened(context, log)
    span = span_of(session, film)
    shown = positions(session.recording, *span, speed / fps)
    site = site_of(session.started, film.world, film.rules)
    player = Player(session.recording)
    with TransientBar("filming", len(shown)) as bar, whole_file(target, log) as file:
        writer = CastWriter(file, screen, speed, bar.advance)
        start = session.recording[0].t + timedelta(seconds=shown[0])
        writer.begin(start, f"PA Console, session {session.started.session}")

        async def direct(made: ReplayedScreen) -> None:
            await writer.shoot(made, shown)

        asyncio.run(film_replay(site, player, screen, direct))
    seconds = (shown[-1] - shown[0]) / speed
    written(target, f"{count(len(shown), 'frame')} of {screen[0]}x{screen[1]}, {seconds:.0f} s")


def size_of(text: str) -> tuple[int, int]:
    """Return the columns and rows of `text`; raises ValueError if the size is not valid."""
    match = re.fullmatch(r"(\d{1,4})[xX×](\d{1,4})", text.strip())
    size = (int(match[1]), int(match[2])) if match else (0, 0)
    if not all(low <= n <= high for low, n, high in zip(LEAST, size, MOST, strict=True)):
        raise ValueError(
            f"--size {text}: give COLUMNSxROWS, e.g. 120x36, from {LEAST[0]}x{LEAST[1]} to "
            f"{MOST[0]}x{MOST[1]}"
        )
    return size


def span_of(session: OpenedSession, film: FilmOptions) -> tuple[float, float]:
    """Return start and end of the film, in seconds; raises ValueError if it would be empty."""
    recording, first = session.recording, film.first
    duration = recording.timeline.duration
    last = duration if film.until is None else min(film.until, duration)
    if film.mission is not None:
        wanted = choose_mission(session.final_state().missions, film.mission).mission.id
        of_it = [
            index
            for index in range(len(recording))
            if recording.of_mission(index) and _mission_at(session, index) == wanted
        ]
        first = max(first, recording.timeline.seconds[of_it[0]])
        last = min(last, recording.timeline.seconds[of_it[-1]])
    if last < first:
        raise ValueError(
            f"nothing to show from {first:g} s to {last:g} s; the session lasts {duration:.1f} s"
        )
    return first, last


def _mission_at(session: OpenedSession, index: int) -> str | None:
    event = session.recording[index]
    data = event.data
    return data.mission.id if isinstance(data, MissionReceived) else event.mission


@app.command("markdown")
def markdown(
    context: typer.Context,
    log: LogArgument,
    mission: Annotated[
        str | None,
        typer.Option(help="Mission to export. Default: the whole session, as a shift report."),
    ] = None,
    target: Annotated[
        Path | None, typer.Option("--out", "-o", help="File to write. Default: stdout.")
    ] = None,
    rules: SessionRulesOption = None,
) -> None:
    """Write a session as GitHub Markdown: a shift report with all traces, or one mission's trace.

    The report begins with the open items. Prompts, answers and rules that were not broken are
    collapsed.
    """
    session = opened(context, log)
    texts, note = rules_of(session.started, rules)
    beside = target.parent if target is not None else Path()
    stills = Path(os.path.relpath(stills_folder(session.recording.path or log), beside)).as_posix()
    problem = session.recording.problem
    notes = tuple(text for text in (note, str(problem) if problem else "") if text)
    if mission is None:
        content, document = "shift report", session_document(session, texts, notes, stills)
    else:
        trace = choose_mission(session.final_state().missions, mission)
        content = f"mission {trace.mission.id}"
        document = mission_document(trace, session.started, texts, notes, stills)
    if target is None:
        print_document(document)
        return
    with whole_file(target, log) as file:
        file.write(visible(document).encode())
    written(target, content)


@app.command("mcap")
def mcap(
    context: typer.Context,
    log: LogArgument,
    target: Annotated[Path, typer.Option("--out", "-o", help="The file to write.")],
    world: SessionWorldOption = None,
) -> None:
    """Write the whole session as MCAP, for Foxglove, Rerun and the mcap tools.

    The topic /telemetry has the pictures, /events/KIND the other events, /notices the event list
    and /scene the checkpoint in 3D. This verb needs the extra `mcap`.
    """
    session = opened(context, log)
    site = world_of(session.started, world)
    if site is None:
        name = session.started.world
        errors.print_line(
            f"note: the world {name!r} is not installed here, so the scene has no ground; "
            "give its file with --world",
            style="yellow",
        )
    with TransientBar("writing", len(session.recording)) as bar, whole_file(target, log) as file:
        messages = write_mcap(session, site, file, bar.advance)
    written(target, count(messages, "message"))
