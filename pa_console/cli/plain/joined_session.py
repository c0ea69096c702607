"""The session of `pa-console console --join URL --plain`: another station's, in lines."""

from asyncio import CancelledError, Runner
from collections.abc import Callable
from contextlib import suppress

from pa_console.cli.mission.trace import print_proposal, print_trace
from pa_console.cli.output import out
from pa_console.cli.plain.joined_console import JoinedConsole
from pa_console.cli.plain.session import Ending, bell, run_lines, say
from pa_console.end_signals import end_signals
from pa_console.settings.schema import Settings
from pa_console.station.joined_station import JoinedStation


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
