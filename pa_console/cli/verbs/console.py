"""`pa-console console`: the console, on a screen or in lines of text."""

import os
import sys
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Annotated

import typer

from pa_console import __version__
from pa_console.cli.options import AttendedOptions, MouseOption
from pa_console.cli.settings_defaults import OBSERVED, settings_of
from pa_console.resources import naming_what_is_missing
from pa_console.terminal.opening_frame import OpeningFrame, frame_file
from pa_console.terminal.output import DRIVER


@dataclass(frozen=True)
class ConsoleOptions(AttendedOptions):
    """The options of a session with an operator."""

    readonly: Annotated[
        bool, typer.Option("--readonly", help="Refuse every command in this console.")
    ] = False
    resume: Annotated[
        bool | None,
        typer.Option(
            "--resume/--new",
            help="Resume a session whose console ended without closing it, or start a new one. "
            "Default: ask.",
        ),
    ] = None
    mouse: MouseOption = True


def console(
    context: typer.Context,
    options: ConsoleOptions,
    join: Annotated[
        str,
        typer.Option(
            "--join",
            metavar="URL",
            help="Join the session of the station in command on a message bus: watch it, "
            "countersign plans that need two people, and stop the team. Other commands are "
            "refused, but a commander may take command.",
        ),
    ] = "",
    plain: Annotated[
        bool,
        typer.Option(
            "--plain", help="Use lines of text instead of a screen, e.g. for a screen reader."
        ),
    ] = False,
) -> None:
    """Open the console: live map, missions, approval, trace and policy browser.

    With --join, the console shows the session of another station, which continues when you leave.
    """
    if not plain and not sys.stdout.isatty() and DRIVER not in os.environ:
        raise ValueError(
            "the console needs a terminal; use 'pa-console mission' in scripts, or --plain"
        )
    if options.agents:
        with naming_what_is_missing("mcp", "agents need"):
            import_module("pa_console.cli.sessions.agents")
    settings = settings_of(context, "world", "rules", "model", "alarms", "mouse", *OBSERVED)
    if join:
        if options.fleet or options.scenario or options.readonly or options.agents:
            raise ValueError(
                "--join can be combined only with --certificates, --world, --rules, --plain and "
                "--mouse"
            )
        from pa_console.cli.sessions.joined import joining  # noqa: PLC0415 - only if used

        with joining(join, options, settings) as joined:
            if not joined.show(settings, plain=plain):
                return
            with joined.reporting_unless_taken(), OpeningFrame(None) as frame:
                from pa_console.cli.sessions.opening import open_console  # noqa: PLC0415 - only if used

                taken = replace(options, fleet=[join])
                open_console(taken, settings, frame, plain=plain, joined=joined)
        return
    drawn = (options.world, options.fleet, options.readonly, settings.values.theme)
    with OpeningFrame(None if plain else frame_file(__version__, *drawn)) as frame:
        from pa_console.cli.sessions.opening import open_console  # noqa: PLC0415 - behind the frame

        open_console(options, settings, frame, plain=plain)
