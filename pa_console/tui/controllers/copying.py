"""Copies a pane's text to the clipboard of the terminal and to a file."""

from pathlib import Path

from pa_console.schema.text import visible
from pa_console.session.state import MissionTrace
from pa_console.tui.controllers.console_session import ConsoleSession
from pa_console.tui.controllers.rules import RulesController
from pa_console.tui.copied_file import export_folder, plan_text, trace_text, write_copy


class CopyController:
    """Copies the trace and the plan of the mission that is shown."""

    def __init__(
        self, session: ConsoleSession, rules: RulesController, copies: Path | None
    ) -> None:
        """`copies` is the folder of the files, None the user's own."""
        self._session, self._rules, self._copies = session, rules, copies

    def copy_trace(self) -> None:
        """Copy the shown trace."""
        trace = self._shown_trace
        if trace is not None:
            recording = self._session.recording
            in_force = {rule.id: rule for rule in self._rules.rulebook.rules}
            rules = recording.rules if recording is not None else in_force
            self._copy("trace", f"{trace.mission.id}-trace.txt", trace_text(trace, rules))

    def copy_plan(self) -> None:
        """Copy the shown plan."""
        trace = self._shown_trace
        if trace is not None:
            self._copy("plan", f"{trace.mission.id}-plan.json", plan_text(trace))

    @property
    def _shown_trace(self) -> MissionTrace | None:
        shown = self._session.shown
        return shown.selected(self._session.shown_state) if shown is not None else None

    def _copy(self, what: str, file: str, text: str) -> None:
        self._session.app.copy_to_clipboard(visible(text))
        where = write_copy(self._copies or export_folder(), file, text)
        self._session.tell(f"{where}, and sent to the terminal's clipboard", f"Copied the {what}")
