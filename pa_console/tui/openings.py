"""The screens that a console can begin with instead of its session: a comparison, an evaluation."""

from pathlib import Path

from pa_console.policy.retrieval.retriever import Retriever
from pa_console.settings.sources import Loaded
from pa_console.station.assembly import Site, load_site
from pa_console.tui.app import ConsoleApp, Opening
from pa_console.tui.screens.compare import CompareScreen, Side
from pa_console.tui.screens.evaluation import EvaluationScreen


def comparison(a: Side, b: Side) -> Opening:
    """Return what shows a comparison over the recording of `a`, to which Escape leads."""

    def show(app: ConsoleApp) -> None:
        app.show_session()
        app.push_screen(CompareScreen(a, b, app.session.clock))

    return show


def evaluation(folder: Path) -> Opening:
    """Return what shows the evaluation in `folder` with no session behind it; q leaves it."""

    def show(app: ConsoleApp) -> None:
        app.push_screen(EvaluationScreen(folder, app.session.clock, over=False))

    return show


def evaluation_console(
    folder: Path, site: Site, *, copies: Path | None = None, settings: Loaded | None = None
) -> ConsoleApp:
    """Return a read-only console on the evaluation in `folder`.

    Its policy browser shows the rules of `site`; `copies` and `settings` are those of the console.
    """
    return ConsoleApp(
        site.world,
        None,
        site.rulebook,
        Retriever(site.rulebook.rules),
        readonly=True,
        copies=copies,
        settings=settings,
        opening=evaluation(folder),
    )


def show_evaluation(folder: Path, settings: Loaded) -> None:
    """Open the evaluation in `folder` on the screen and return when it is left."""
    site = load_site("checkpoint", "checkpoint")
    evaluation_console(folder, site, settings=settings).run(mouse=settings.values.mouse)
