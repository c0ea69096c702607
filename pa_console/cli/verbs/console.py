"""`pa-console console`: the console, on a screen or in lines."""

import os
import sys
from asyncio import Runner
from collections.abc import Generator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from importlib import import_module
from threading import Event
from typing import TYPE_CHECKING, Annotated

import typer

from pa_console.cli.options import AgentsOption, SessionOptions, naming_what_is_missing
from pa_console.cli.settings_defaults import OBSERVED, settings_of
from pa_console.end_signals import exit_code_of
from pa_console.llm.local.engine import Engine
from pa_console.llm.models.cache import Progress
from pa_console.llm.models.catalogue import find_model
from pa_console.settings.sources import LoadedSettings
from pa_console.terminal.output import DRIVER, FAILED, errors, require_keys

if TYPE_CHECKING:
    from pa_console.cli.sessions.joined import JoinedSession


@dataclass(frozen=True)
class ConsoleOptions(SessionOptions):
    """The options of a session with an operator."""

    agents: AgentsOption = 0
    readonly: Annotated[
        bool, typer.Option("--readonly", help="Look only: every command is refused.")
    ] = False
    resume: Annotated[
        bool | None,
        typer.Option(
            "--resume/--new",
            help="Go on with a session whose console ended without closing it, or begin a new one; "
            "asked where neither is given.",
        ),
    ] = None
    mouse: Annotated[
        bool,
        typer.Option("--mouse/--no-mouse", help="Take the mouse, or leave it to the terminal."),
    ] = True


def console(
    context: typer.Context,
    options: ConsoleOptions,
    join: Annotated[
        str,
        typer.Option(
            "--join",
            metavar="URL",
            help="Watch the session of the station in command on a message bus, countersign what "
            "takes two people, stop the team; nothing else is commanded from here. A commander "
            "may take command.",
        ),
    ] = "",
    plain: Annotated[
        bool,
        typer.Option(
            "--plain", help="Lines and questions in place of a screen, as for a screen reader."
        ),
    ] = False,
) -> None:
    """Open the console: live checkpoint, policy browser, missions, trace and approval.

    With --join, the session of another station is shown; with --plain too, as lines, where Ctrl-C
    leaves it and it goes on.
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
                "--join goes with --certificates, --world, --rules, --plain and --mouse alone"
            )
        from pa_console.cli.sessions.joined import Joining, joining  # noqa: PLC0415 - then

        asked = Joining(join, options.certificates, options.world, options.rules)
        with joining(asked, settings) as joined:
            if not joined.show(settings, plain=plain):
                return
            with joined.told_unless_taken():
                _open(replace(options, fleet=[join]), settings, plain=plain, joined=joined)
        return
    _open(options, settings, plain=plain)


def _open(
    options: SessionOptions,
    settings: LoadedSettings,
    *,
    plain: bool,
    joined: "JoinedSession | None" = None,
) -> None:
    """Open a session of this station's own; where one was `joined`, command is taken from it."""
    values = settings.values
    with Runner() as loop, ExitStack() as observes:
        with (
            ThreadPoolExecutor(1) as hashing,
            _stopped_when_left() as going_on,
            _told("Opening the console ..." if joined is None else joined.opening),
        ):
            from pa_console.llm.remote.servers import Servers, session_models  # noqa: PLC0415 - no help waits for it

            chosen = session_models(options.model, values.judge_server, values.second_reader)
            servers = Servers.open(
                chosen.named, plain=values.plain_servers, patience_s=values.server_patience_s
            )
            found = hashing.submit(find_model, chosen.own, going_on, chosen.second_reader)
            from pa_console.cli.sessions.live import open_live  # noqa: PLC0415 - meanwhile
            from pa_console.cli.sessions.observing import observing  # noqa: PLC0415

            beside = observes.enter_context(observing(values, options.world))
            engine = Engine(found.result(), require_sandbox=options.require_sandbox)
        loop.run(engine.start())
        try:
            authority = joined.succession.authority if joined is not None else None
            opened = open_live(options, values, lambda: engine, servers, authority)
            opened.station.listen_to(beside.outside)
            if plain:
                from pa_console.cli.sessions.plain import run_plain as run  # noqa: PLC0415
            else:
                with _told("Opening the screen ..."):
                    from pa_console.cli.sessions.screen import run_screen as run  # noqa: PLC0415

                require_keys("use 'pa-console mission' in scripts, or --plain")
            observer = beside.observer
            if options.agents:
                from pa_console.cli.sessions.agents import admit_agents  # noqa: PLC0415 - then only

                observer = observes.enter_context(admit_agents(opened, observer))
            prepared = run(opened, settings, observer)
            if joined is not None:
                joined.take_command(opened)
        except BaseException:
            loop.run(engine.close())
            raise
        ended_by = prepared(loop)
    if ended_by:
        raise typer.Exit(exit_code_of(ended_by))
    if opened.station.failure:
        errors.print_line(opened.station.failure, style="bold red")
        raise typer.Exit(FAILED)


@contextmanager
def _stopped_when_left() -> Generator[Progress]:
    """Yield a progress callback that stops the preparing of weights once this is left."""
    left = Event()

    def going_on(_done: int, _total: int, _text: str) -> None:
        if left.is_set():
            raise KeyboardInterrupt

    try:
        yield going_on
    finally:
        left.set()


@contextmanager
def _told(what: str) -> Generator[None]:
    """Show the present step on a terminal, in a line that is gone afterwards."""
    seen = sys.stderr.isatty()
    if seen:
        sys.stderr.write(what)
        sys.stderr.flush()
    try:
        yield
    finally:
        if seen:
            sys.stderr.write(f"\r{' ' * len(what)}\r")
            sys.stderr.flush()
