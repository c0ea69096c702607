"""The session of `pa-console serve`: a station in real time, its log, and the interface to it."""

import asyncio
import signal
from asyncio import Runner
from collections.abc import Callable
from contextlib import aclosing

from pa_console.cli.sessions.live import Asked, LiveSession, open_live
from pa_console.cli.sessions.log import open_log, tell_of_witness
from pa_console.cli.sessions.observing import observing
from pa_console.cli.sessions.tokens import this_user, token_book
from pa_console.end_signals import end_signals, exit_code_of
from pa_console.http.connections import Listening, listen
from pa_console.http.http_app import serving
from pa_console.http.served_session import ServedSession
from pa_console.http.tokens import TokenBook
from pa_console.llm.local.engine import Engine
from pa_console.llm.models.catalogue import find_model
from pa_console.observability import Observer
from pa_console.session.log.chain import LogError
from pa_console.session.log.writer import LogWriter
from pa_console.session.state import SessionState
from pa_console.settings.sources import Loaded
from pa_console.signing import load_signer
from pa_console.terminal.output import FAILED, errors, out


def serve_session(
    asked: Asked, settings: Loaded, model: str | None, port: int, witness: str
) -> int:
    """Serve a new session until Ctrl-C, SIGTERM or its own end; return the exit code.

    Raises DocumentError or ValueError for what cannot be opened, LogError for a log that cannot be.
    """
    values = settings.values
    with (
        listen(port) as listening,
        observing(values, asked.world, live=True) as beside,
        Runner() as loop,
    ):
        engine = Engine(find_model(model, second_reader=values.second_reader))
        try:
            opened = open_live(asked, values, engine)
            tokens = token_book(opened.authority.trust if opened.authority else None)
            writer = open_log(
                values, opened.station.session, load_signer(), _cannot_write, None, witness
            )
        except BaseException:
            loop.run(engine.close())
            raise
        ending = _Ending()
        opened.share(writer)
        with end_signals(ending.end), writer:
            opened.station.write_to(writer)
            opened.station.listen_to(beside.outside)
            loop.run(_serve(opened, writer, tokens, listening, beside.observer, ending))
        tell_of_witness(writer)
        out.print_line(f"session log: {writer.path}")
    if opened.station.failure:
        errors.print_line(opened.station.failure, style="bold red")
        return FAILED
    return exit_code_of(ending.ended_by) if ending.ended_by else 0


class _Ending:
    """Ends the session because of a signal; any thread may call `end`."""

    def __init__(self) -> None:
        self.ended_by = 0
        self.close: Callable[[], object] = lambda: None

    def end(self, number: int) -> None:
        self.ended_by = number
        self.close()


async def _serve(
    opened: LiveSession,
    writer: LogWriter,
    tokens: TokenBook,
    listening: Listening,
    observer: Observer,
    ending: _Ending,
) -> None:
    station, loop = opened.station, asyncio.get_running_loop()
    state = SessionState()
    session = ServedSession(station, state, lambda: writer.path, authority=opened.authority)
    closing: list[asyncio.Task[None]] = []

    def close(reason: str) -> None:
        closing.append(asyncio.create_task(station.close(reason)))

    def interrupted() -> None:
        close("closed by Ctrl-C")

    ending.close = lambda: loop.call_soon_threadsafe(close, "closed by a signal")
    if ending.ended_by:
        close("closed by a signal")
    loop.add_signal_handler(signal.SIGINT, interrupted)
    try:
        async with (
            serving(session, tokens, listening, _failed) as address,
            aclosing(station.run()) as events,
        ):
            _greet(address, tokens)
            async for event in events:
                state.apply(event)
                session.take(event)
                observer(event)
                await asyncio.sleep(0)
    finally:
        ending.close = lambda: None
        loop.remove_signal_handler(signal.SIGINT)
        await asyncio.gather(*closing)


def _greet(address: str, tokens: TokenBook) -> None:
    """Show the address of the interface, and the access token."""
    out.print_line(f"{address}/docs")
    if not tokens.listed():
        person = this_user()
        token = tokens.make(person, "operator", keep=False)
        errors.print_line(
            f"no token was made yet; this one of {person}, operator, is for this session alone and "
            f"is not shown again:\n{token}"
        )
    errors.print("Ctrl-C ends the session: what moves goes to safety, the log is closed.")


def _cannot_write(error: LogError) -> None:
    errors.print_line(f"warning: {error}", style="bold red")


def _failed(error: Exception) -> None:
    told = f"a request failed: {type(error).__name__}: {error}"
    errors.print_line(told, style="bold red")
