"""The session of `pa-console console --plain`: a station, its log, and lines in and out."""

import asyncio
import signal
import sys
from asyncio import CancelledError, Runner
from collections.abc import Callable
from contextlib import suppress
from typing import Protocol

from pa_console.cli.sessions.live import LiveSession
from pa_console.cli.sessions.log import open_log, tell_of_witness, usual_file
from pa_console.end_signals import end_signals
from pa_console.llm.local.engine import Engine
from pa_console.observability import Observer
from pa_console.session.log.chain import LogError
from pa_console.settings.schema import Settings
from pa_console.settings.sources import Loaded
from pa_console.signing import load_signer
from pa_console.station.joined_station import JoinedStation
from pa_console.terminal.joined_console import JoinedConsole
from pa_console.terminal.line_console import LineConsole
from pa_console.terminal.mission import print_proposal, print_trace
from pa_console.terminal.output import errors, out
from pa_console.terminal.typed_lines import InputLines
from pa_console.views.waiting import Waiting, load_usual, save_usual


def run_plain(
    opened: LiveSession, engine: Engine, settings: Loaded, witness: str, observer: Observer
) -> Callable[[Runner], int]:
    """Open the log; return what runs the lines and returns the signal that ended them, 0 for none.

    Raises LogError when the log cannot be opened.
    """
    station, model, values = opened.station, engine.model.sha256, settings.values

    def cannot_write(error: LogError) -> None:
        errors.print_line(f"warning: {error}", style="bold red")

    signer = load_signer()
    writer = open_log(
        values,
        station.session,
        signer,
        cannot_write,
        opened.log,
        witness,
        resumed=opened.log is not None,
    )
    opened.share(writer)

    console = LineConsole(
        station,
        say,
        lambda trace, number: print_proposal(out, trace, number),
        lambda trace: print_trace(out, trace),
        Waiting(load_usual(usual_file(), model)),
        hold_s=values.approval_delay_s,
        called=bell(values),
        observer=observer,
    )

    def run(loop: Runner) -> int:
        ending = Ending()
        with end_signals(ending.end), writer:
            station.write_to(writer)
            with suppress(CancelledError):
                loop.run(run_lines(console, ending))
            save_usual(usual_file(), model, console.waiting.usual)
        tell_of_witness(writer)
        if not ending.ended_by:
            say(f"session log: {writer.path}")
        return ending.ended_by

    return run


class Lines(Protocol):
    """A console that is typed at in lines."""

    async def run(self, lines: asyncio.Queue[str | None], forget: Callable[[], None] = ...) -> None:
        """Carry on until it is left; `forget` drops what was typed too early."""
        ...

    def interrupted(self) -> None:
        """Answer Ctrl-C."""
        ...


class Ending:
    """Ends the session because of a signal; any thread may call `end`."""

    def __init__(self) -> None:
        self.ended_by = 0
        self.cancel: Callable[[], object] = lambda: None

    def end(self, number: int) -> None:
        """End because of the signal `number`."""
        self.ended_by = number
        self.cancel()


async def run_lines(console: Lines, ending: Ending) -> None:
    """Run a console over the lines of standard input until it is left, or `ending` ends it."""
    loop, task = asyncio.get_running_loop(), asyncio.current_task()
    assert task is not None
    ending.cancel = lambda: loop.call_soon_threadsafe(task.cancel)
    if ending.ended_by:
        task.cancel()
    lines = InputLines(loop)
    loop.add_signal_handler(signal.SIGINT, console.interrupted)
    lines.start()
    try:
        await console.run(lines.queue, lines.forget_typed)
    finally:
        ending.cancel = lambda: None
        loop.remove_signal_handler(signal.SIGINT)
        lines.close()


def bell(values: Settings) -> Callable[[], None]:
    """Return what calls the operator at a terminal, where the settings want that."""

    def call() -> None:
        if values.bell and sys.stdout.isatty():
            sys.stdout.write("\a")
            sys.stdout.flush()

    return call


def say(text: str) -> None:
    """Print a line at once."""
    out.print_line(text)
    sys.stdout.flush()


def run_joined_plain(
    station: JoinedStation, values: Settings, command_question: Callable[[], str] | None
) -> tuple[bool, int]:
    """Follow a session in lines until it ends or is left.

    Return whether it was left to take command, and the signal that ended it, 0 for none.
    """
    console = JoinedConsole(
        station,
        say,
        lambda trace, number: print_proposal(out, trace, number),
        lambda trace: print_trace(out, trace),
        hold_s=values.approval_delay_s,
        called=bell(values),
        command_question=command_question,
    )
    ending = Ending()
    with end_signals(ending.end), Runner() as loop, suppress(CancelledError):
        loop.run(run_lines(console, ending))
    if not console.takes_command and not ending.ended_by and not console.state.ended:
        say(f"left; the session of {station.station} goes on")
    return console.takes_command and not ending.ended_by, ending.ended_by
