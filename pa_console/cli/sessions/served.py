"""The session of `pa-console serve`: a station in real time, its log, and its HTTP interface."""

import asyncio
import signal
from asyncio import Runner
from contextlib import ExitStack, aclosing

from pa_console.cli.options import SessionOptions
from pa_console.cli.sessions.live import LiveSession, open_live
from pa_console.cli.sessions.log import report_witness_problem
from pa_console.cli.sessions.observing import observing
from pa_console.cli.sessions.tokens import offer_token, token_book
from pa_console.end_signals import EndableRun, exit_code_of
from pa_console.http.connections import Listening, listen
from pa_console.http.http_app import serving
from pa_console.http.served_session import ServedSession
from pa_console.http.tokens import TokenBook
from pa_console.llm.local.engine import Engine
from pa_console.llm.models.catalogue import find_model
from pa_console.llm.remote.servers import Servers, session_models
from pa_console.observability import Observer
from pa_console.session.log.writer import LogWriter
from pa_console.session.state import SessionState
from pa_console.settings.sources import LoadedSettings
from pa_console.terminal.output import FAILED, errors, out


def serve_session(options: SessionOptions, settings: LoadedSettings, port: int) -> int:
    """Serve a new session until it ends, or Ctrl-C or SIGTERM ends it; return the exit code.

    Raises DocumentError or ValueError if the session cannot be opened, and LogError if its log
    cannot be opened.
    """
    values = settings.values
    with (
        listen(port) as listening,
        observing(values, options, live=True) as beside,
        ExitStack() as observes,
        Runner() as loop,
    ):
        chosen = session_models(options.model, values.judge_server, values.second_reader)
        servers = Servers.open(
            chosen.named, plain=values.plain_servers, patience_s=values.server_patience_s
        )
        model = find_model(chosen.own, second_reader=chosen.second_reader)
        engine = Engine(model, require_sandbox=options.require_sandbox)
        try:
            opened = open_live(options, values, lambda: engine, servers)
            tokens = token_book(opened.authority.trust if opened.authority else None)
            writer, observer = opened.open_log(), beside.observer
            if options.agents:
                from pa_console.cli.sessions.agents import admit_agents  # noqa: PLC0415 - only if used

                observer = observes.enter_context(admit_agents(opened, observer))
        except BaseException:
            loop.run(engine.close())
            raise
        endable = EndableRun()
        with opened.logged(writer, endable.end):
            opened.station.listen_to(beside.outside)
            endable.run(_serve(opened, writer, tokens, listening, observer, endable), loop)
        report_witness_problem(writer)
        out.print_line(f"session log: {writer.path}")
    if opened.station.failure:
        errors.print_line(opened.station.failure, style="bold red")
        return FAILED
    return exit_code_of(endable.ended_by) if endable.ended_by else 0


async def _serve(
    opened: LiveSession,
    writer: LogWriter,
    tokens: TokenBook,
    listening: Listening,
    observer: Observer,
    endable: EndableRun,
) -> None:
    station, loop = opened.station, asyncio.get_running_loop()
    state = SessionState()
    session = ServedSession(station, state, lambda: writer.path, authority=opened.authority)
    closing: list[asyncio.Task[None]] = []

    def close(reason: str) -> None:
        closing.append(asyncio.create_task(station.close(reason)))

    def interrupted() -> None:
        close("closed by Ctrl-C")

    endable.cancel = lambda: loop.call_soon_threadsafe(close, "closed by a signal")
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
        loop.remove_signal_handler(signal.SIGINT)
        await asyncio.gather(*closing)


def _greet(address: str, tokens: TokenBook) -> None:
    """Print the address of the interface and, if no token has been made yet, an access token."""
    out.print_line(f"{address}/docs")
    offer_token(tokens, "session")
    errors.print("Ctrl-C ends the session: moving assets go to safety, and the log is closed.")


def _failed(error: Exception) -> None:
    problem = f"a request failed: {type(error).__name__}: {error}"
    errors.print_line(problem, style="bold red")
