"""`pa-console export`: a recorded session in another tool's format."""

from pathlib import Path
from typing import Annotated

import typer

from pa_console.cli.export import screens
from pa_console.cli.export.source import (
    ExportBar,
    LogArgument,
    SessionRules,
    SessionWorld,
    opened,
    written,
)
from pa_console.cli.output import errors, print_document
from pa_console.export.markdown import mission_document
from pa_console.export.mcap_file import write_mcap
from pa_console.export.source_log import choose_mission, rules_of, whole_file, world_of
from pa_console.schema.text import count, visible

app = typer.Typer(
    help="Write a recorded session as Markdown, MCAP, SVG or asciinema cast.",
    no_args_is_help=True,
    rich_markup_mode=None,
)

app.command("svg")(screens.svg)
app.command("cast")(screens.cast)


@app.command("markdown")
def markdown(
    log: LogArgument,
    mission: Annotated[
        str | None,
        typer.Option(help="Id of the mission; may be left out when the session has only one."),
    ] = None,
    target: Annotated[
        Path | None, typer.Option("--out", "-o", help="The file; without it, standard output.")
    ] = None,
    rules: SessionRules = None,
) -> None:
    """Write one mission's whole trace as GitHub Markdown: rules, prompts, plans, checks, outcome.

    Prompts, answers and rules that were not broken are folded away.
    """
    session = opened(log)
    trace = choose_mission(session.final_state().missions, mission)
    known, note = rules_of(session.started, rules)
    problem = session.recording.problem
    notes = tuple(text for text in (note, str(problem) if problem else "") if text)
    document = mission_document(trace, session.started, known, notes)
    if target is None:
        print_document(document)
        return
    with whole_file(target, log) as file:
        file.write(visible(document).encode())
    written(target, f"mission {trace.mission.id}")


@app.command("mcap")
def mcap(
    log: LogArgument,
    target: Annotated[Path, typer.Option("--out", "-o", help="The file to write.")],
    world: SessionWorld = None,
) -> None:
    """Write the whole session as MCAP, for Foxglove, Rerun and the mcap tools.

    /telemetry has the pictures, /events/KIND every other event, /notices the event list and
    /scene the checkpoint in 3D. Needs the extra: pip install 'pa-console[mcap]'
    """
    session = opened(log)
    site = world_of(session.started, world)
    if site is None:
        name = session.started.world
        errors.print(
            f"note: the world {name!r} is not installed here, so the scene has no ground; "
            "give its file with --world",
            style="yellow",
            markup=False,
            soft_wrap=True,
        )
    with ExportBar("writing", len(session.recording)) as bar, whole_file(target, log) as file:
        messages = write_mcap(session, site, file, bar.advance)
    written(target, count(messages, "message"))
