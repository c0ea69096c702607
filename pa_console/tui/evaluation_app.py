"""`pa-console eval show`: the evaluation screen alone, without a session behind it."""

from pathlib import Path

from pa_console.orchestrator.station.assembly import Site, load_site
from pa_console.policy.retrieval.retriever import Retriever
from pa_console.settings.sources import Loaded
from pa_console.tui.app import ConsoleApp
from pa_console.tui.screens.evaluation import EvaluationScreen


class EvaluationApp(ConsoleApp):
    """A read-only console whose first screen is an evaluation; q leaves it."""

    def __init__(
        self,
        folder: Path,
        site: Site,
        *,
        copies: Path | None = None,
        settings: Loaded | None = None,
    ) -> None:
        """Show the evaluation in `folder`; the policy browser shows the rules of `site`."""
        super().__init__(
            site.world,
            None,
            site.rulebook,
            Retriever(site.rulebook.rules),
            readonly=True,
            copies=copies,
            settings=settings,
        )
        self._folder = folder

    def show_first(self) -> None:
        """Show the evaluation."""
        self.push_screen(EvaluationScreen(self._folder, self.clock, over=False))


def show_evaluation(folder: Path, settings: Loaded) -> None:
    """Open the evaluation in `folder` on the screen and return when it is left."""
    site = load_site("checkpoint", "checkpoint")
    EvaluationApp(folder, site, settings=settings).run(mouse=settings.values.mouse)
