"""The session of a console on its screen."""

import gc
from asyncio import Runner
from collections.abc import Callable

from pa_console.cli.sessions.live import LiveSession
from pa_console.cli.sessions.log import report_witness_problem, usual_file
from pa_console.observability import Observer
from pa_console.session.log.chain import LogError
from pa_console.session.log.writer import default_folder
from pa_console.settings.sources import LoadedSettings
from pa_console.station.earlier.last_session import LastSession
from pa_console.terminal.opening_frame import OpeningFrame
from pa_console.terminal.output import out
from pa_console.tui.actions import first_key
from pa_console.tui.app import ConsoleApp
from pa_console.tui.over_frame import keep_first, take_over
from pa_console.views.waiting import load_usual, save_usual


def run_screen(
    opened: LiveSession, settings: LoadedSettings, observer: Observer, frame: OpeningFrame
) -> Callable[[Runner], int]:
    """Open the log; return a function that runs the screen.

    The function returns the signal that ended the screen, or 0. The screen takes the place of
    `frame` on the terminal. Raises LogError if the log cannot be opened.
    """
    site, station, model = opened.site, opened.station, opened.engine.model.sha256

    def cannot_write(error: LogError) -> None:
        app.notify(str(error), title="Session log", severity="error", timeout=30, markup=False)

    policy, last = site.world.low_battery_policy, None
    station.offer_at_start(policy)
    if not station.readonly and opened.resumed_log is None:
        folder = settings.values.logs or default_folder()
        last = LastSession(folder, site.world_sha256, first_key("take_up"), policy)
        station.listen_to(last)
    writer = opened.open_log(cannot_write)
    app = ConsoleApp(
        site.world,
        station,
        site.rulebook,
        station.retriever,
        readonly=station.readonly,
        settings=settings,
        rules_file=site.rules_path,
        usual=load_usual(usual_file(), model),
        last=last,
        log=writer.path,
    )
    app.feed.observer = observer
    app.first_painted = lambda: keep_first(app, frame)

    def run(loop: Runner) -> int:
        leaving = app.controllers.leaving
        take_over(app, frame)
        with opened.logged(writer, leaving.end):
            keep_loaded()
            loop.run(app.run_async(mouse=settings.values.mouse))
            save_usual(usual_file(), model, app.feed.waiting.usual)
        report_witness_problem(writer)
        out.print_line(f"session log: {writer.path}")
        return leaving.ended_by

    return run


def keep_loaded() -> None:
    """Exclude the objects loaded so far, which are needed until the end, from garbage collection.

    With 1,000 assets, a collection would delay the screen by 70 ms. Existing garbage is not
    collected first, because that would delay the first painting by 80 ms.
    """
    gc.freeze()
