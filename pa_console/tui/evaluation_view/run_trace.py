"""Opens the log of an evaluation's run over its screen, at its end, with the trace in view."""

from functools import partial
from pathlib import Path

from textual.screen import Screen

from pa_console.evaluation.run_record import RunRecord
from pa_console.schema.document import DocumentError
from pa_console.tui.protocols import Clock
from pa_console.tui.replay.recordings import OpenedLog, log_of_run, open_run
from pa_console.tui.screens.opening_log import OpeningLog, is_large
from pa_console.tui.screens.recording import RecordingScreen


def show_trace(over: Screen[None], record: RunRecord, folder: Path, clock: Clock) -> None:
    """Show the trace of `record`, whose evaluation is in `folder`; what is wrong with it is told.

    A large log is read beside the screen that it is shown over.
    """

    def show(opened: OpenedLog | None) -> None:
        if opened is None:
            return
        if opened.note:
            over.notify(opened.note, title=record.mission, severity="warning", markup=False)
        screen = RecordingScreen(
            opened.world, opened.rules, opened.player, clock, over=True, view="trace"
        )
        over.app.push_screen(screen)

    try:
        log = log_of_run(record.log, folder)
        if is_large(log):
            over.app.push_screen(OpeningLog(log, partial(open_run, log, folder)), show)
        else:
            show(open_run(log, folder))
    except (ValueError, OSError, DocumentError) as error:
        over.notify(str(error), title="No trace", severity="error", timeout=10, markup=False)
