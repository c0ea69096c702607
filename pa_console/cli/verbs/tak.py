"""`pa-console tak`: the picture of a session on the map of a TAK server."""

from pathlib import Path
from typing import Annotated

import typer

from pa_console.cli.options import CertificatesOption
from pa_console.cli.sessions.observing import naming_what_is_missing
from pa_console.cli.settings_defaults import settings_of


def tak(
    context: typer.Context,
    server: Annotated[
        str,
        typer.Option(
            "--server", metavar="URL", help="The TAK server: tls://HOST:8089, or tcp://HOST:8087."
        ),
    ],
    join: Annotated[
        str,
        typer.Option(
            "--join",
            metavar="URL",
            help="Follow the session that a station shares on a message bus: "
            "mqtts://host:8883/site.",
        ),
    ] = "",
    certificates: CertificatesOption = None,
    replay: Annotated[
        str,
        typer.Option(
            "--replay",
            metavar="SESSION",
            help="Play a recorded session: its log, its id, or 'last'; marked as a replay.",
        ),
    ] = "",
    speed: Annotated[
        float, typer.Option(min=0.1, max=32.0, help="With --replay: how many times as fast.")
    ] = 1.0,
    world: Annotated[
        str | None, typer.Option("--world", help="The session's world, when it is a file.")
    ] = None,
    origin: Annotated[
        str,
        typer.Option(
            "--origin",
            metavar="LAT,LON[,BEARING[,ALTITUDE]]",
            help="Where on the earth the world's (0, 0) is, in place of what the world file says.",
        ),
    ] = "",
    name: Annotated[
        str | None,
        typer.Option(
            help="What this site is called in the ids on the map; default: the world's name."
        ),
    ] = None,
    every: Annotated[
        float, typer.Option(min=0.1, max=60.0, help="Seconds between two pictures, at least.")
    ] = 1.0,
    tls_cert: Annotated[
        Path | None,
        typer.Option("--tls-cert", help="The client's certificate: PEM, or PKCS #12 (.p12)."),
    ] = None,
    tls_key: Annotated[
        Path | None, typer.Option("--tls-key", help="Its key (PEM), when it is not in that file.")
    ] = None,
    tls_ca: Annotated[
        Path | None,
        typer.Option("--tls-ca", help="The authority (PEM) that vouches for the server."),
    ] = None,
) -> None:
    """Show a session on TAK maps (ATAK, WinTAK) as Cursor on Target; nothing is taken from there.

    It lasts until the session ends, or Ctrl-C.
    """
    if bool(join) == bool(replay):
        raise ValueError(
            "give --join URL for a live session, or --replay SESSION for a recorded one"
        )
    settings = settings_of(context)
    with naming_what_is_missing():
        from pa_console.cli.sessions.followed import FollowOptions, show  # noqa: PLC0415 - no help waits for it
    asked = FollowOptions(
        server=server,
        tls=(tls_cert, tls_key, tls_ca),
        join=join,
        certificates=certificates,
        replay=replay,
        speed=speed,
        world=world,
        origin=origin,
        name=name,
        every=every,
    )
    if code := show(asked, settings):
        raise typer.Exit(code)
