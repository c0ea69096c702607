"""The session of a console; its model is located while modules are still being imported."""

from asyncio import Runner
from collections.abc import Generator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from functools import partial
from threading import Event
from typing import TYPE_CHECKING

import typer

from pa_console.cli.options import SessionOptions
from pa_console.end_signals import exit_code_of
from pa_console.llm.local.engine import Engine
from pa_console.llm.models.cache import Progress
from pa_console.llm.models.catalogue import find_model
from pa_console.llm.remote.servers import Servers, session_models
from pa_console.settings.sources import LoadedSettings
from pa_console.terminal.opening_frame import OpeningFrame
from pa_console.terminal.output import FAILED, errors, require_keys

if TYPE_CHECKING:
    from pa_console.cli.sessions.joined import JoinedSession


def open_console(
    options: SessionOptions,
    settings: LoadedSettings,
    frame: OpeningFrame,
    *,
    plain: bool,
    joined: "JoinedSession | None" = None,
) -> None:
    """Open a session of this station behind `frame`, and run its console.

    If a session was `joined`, this station takes command of it. Raises typer.Exit if a signal ended
    the session, or if the session failed.
    """
    values = settings.values
    with Runner() as loop, ExitStack() as observes:
        with (
            ThreadPoolExecutor(1) as hashing,
            _stopped_when_left() as going_on,
            frame.telling("Opening the console ..." if joined is None else joined.opening),
        ):
            chosen = session_models(options.model, values.judge_server, values.second_reader)
            servers = Servers.open(
                chosen.named, plain=values.plain_servers, patience_s=values.server_patience_s
            )
            model = hashing.submit(find_model, chosen.own, going_on, chosen.second_reader)
            from pa_console.cli.sessions.live import open_live  # noqa: PLC0415 - imported meanwhile
            from pa_console.cli.sessions.observing import observing  # noqa: PLC0415

            beside = observes.enter_context(observing(values, options))
            engine = Engine(model.result(), require_sandbox=options.require_sandbox)
        loop.run(engine.start())
        try:
            authority = joined.succession.authority if joined is not None else None
            opened = open_live(options, values, lambda: engine, servers, authority)
            opened.station.listen_to(beside.outside)
            if plain:
                from pa_console.cli.sessions.plain import run_plain as run  # noqa: PLC0415
            else:
                with frame.telling("Opening the screen ..."):
                    from pa_console.cli.sessions.screen import run_screen  # noqa: PLC0415

                run = partial(run_screen, frame=frame)
                require_keys("use 'pa-console mission' in scripts, or --plain")
            observer = beside.observer
            if options.agents:
                from pa_console.cli.sessions.agents import admit_agents  # noqa: PLC0415 - only if used

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
    """Yield a progress callback that stops the preparation of weights once the block has ended."""
    left = Event()

    def going_on(_done: int, _total: int, _text: str) -> None:
        if left.is_set():
            raise KeyboardInterrupt

    try:
        yield going_on
    finally:
        left.set()
