"""`pa-console replay A --compare B --screen`: two recordings at the point where they differ."""

from typing import Any

from pa_console.tui.app import ConsoleApp
from pa_console.tui.screens.compare import CompareScreen, Side


class ComparingApp(ConsoleApp):
    """The replaying console that begins with a comparison; Escape leads to the first recording."""

    def __init__(self, sides: tuple[Side, Side], *site: Any, **options: Any) -> None:
        """`site` and `options` are those of the console, with a player of the first side."""
        super().__init__(*site, **options)
        self._sides = sides

    def show_first(self) -> None:
        """Show the comparison over the recording."""
        super().show_first()
        self.push_screen(CompareScreen(*self._sides, self.clock))
