"""The session of `pa-console console --plain`, live or joined, in lines of text."""

import asyncio
import signal
import sys
from asyncio import Runner
from collections.abc import Callable
from functools import partial

from pa_console.cli.sessions.live import LiveSession
from pa_console.cli.sessions.log import report_witness_problem, usual_file
from pa_console.end_signals import EndableRun, end_signals
from pa_console.observability import Observer
from pa_console.settings.schema import Settings
from pa_console.settings.sources import LoadedSettings
from pa_console.station.joined.joined_station import JoinedStation
from pa_console.terminal.line_console import JoinedConsole, LineConsole
from pa_console.terminal.mission import print_proposal, print_trace
from pa_console.terminal.output import out
from pa_console.terminal.session_lines import LineOutput, SessionLines
from pa_console.terminal.typed_lines import InputLines
from pa_console.views.waiting import Waiting, load_usual, save_usual


def run_plain(
    opened: LiveSession, settings: LoadedSettings, observer: Observer
) -> Callable[[Runner], int]:
    """Open the log; return a function that runs the console in lines.

    The function returns the signal that ended the console, or 0. Raises LogError if the log cannot
    be opened.
    """
    model, values = opened.engine.model.sha256, settings.values
    writer = opened.open_log()
    console = LineConsole(
        opened.station, _output(values), Waiting(load_usual(usual_file(), model)), observer
    )

    def run(loop: Runner) -> int:
        endable = EndableRun()
        with opened.logged(writer, endable.end):
            endable.run(run_lines(console), loop)
            save_usual(usual_file(), model, console.waiting.usual)
        report_witness_problem(writer)
        if not endable.ended_by:
            say(f"session log: {writer.path}")
        return endable.ended_by

    return run


async def run_lines(console: SessionLines) -> None:
    """Run a console on the lines of standard input until the operator leaves."""
    loop = asyncio.get_running_loop()
    lines = InputLines(loop)
    loop.add_signal_handler(signal.SIGINT, console.interrupted)
    lines.start()
    try:
        await console.run(lines.queue, lines.forget_typed)
    finally:
        loop.remove_signal_handler(signal.SIGINT)
        lines.close()


def _output(values: Settings) -> LineOutput:
    """Return the output of a line console, with the approval delay and the bell of the settings."""

    def call() -> None:
        if values.bell and sys.stdout.isatty():
            sys.stdout.write("\a")
            sys.stdout.flush()

    plan, trace = partial(print_proposal, out), partial(print_trace, out)
    return LineOutput(say, plan, trace, values.approval_delay_s, call)


def say(text: str) -> None:
    """Print a line at once."""
    out.print_line(text)
    sys.stdout.flush()


def run_joined_plain(
    station: JoinedStation, values: Settings, command_question: Callable[[], str] | None
) -> tuple[bool, int]:
    """Show a joined session in lines until it ends or the operator leaves.

    Returns True if the operator left to take command, and the signal that ended the console, or 0.
    """
    console = JoinedConsole(station, _output(values), command_question)
    endable = EndableRun()
    with end_signals(endable.end):
        endable.run(run_lines(console))
    if not console.takes_command and not endable.ended_by and not console.state.ended:
        say(f"you have left; the session of {station.station} continues")
    return console.takes_command and not endable.ended_by, endable.ended_by
