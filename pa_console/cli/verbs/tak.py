"""`pa-console tak`: a shared or recorded session on the map of a TAK server."""

import typer

from pa_console.cli.options import FollowOptions
from pa_console.cli.settings_defaults import settings_of
from pa_console.resources import naming_what_is_missing


def tak(context: typer.Context, options: FollowOptions) -> None:
    """Show a session on TAK maps (ATAK, WinTAK) as Cursor on Target.

    Data from the TAK server is ignored. The verb runs until the session ends or you press Ctrl-C.
    """
    if bool(options.join) == bool(options.replay):
        raise ValueError(
            "give either --join URL for a live session or --replay SESSION for a recorded one"
        )
    settings = settings_of(context)
    with naming_what_is_missing("tak", "TAK maps need"):
        from pa_console.cli.sessions.on_map import show  # noqa: PLC0415 - not needed for help
    if code := show(options, settings):
        raise typer.Exit(code)
