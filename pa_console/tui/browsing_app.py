"""The half of the app that only looks: panes, traces, help, policies, copies; legal everywhere."""

import time
from collections.abc import Mapping
from pathlib import Path

from pa_console.schema.visible_text import visible
from pa_console.schema.world import World
from pa_console.session.replay.player import Player
from pa_console.tui.copied_file import export_folder, plan_text, trace_text, write_copy
from pa_console.tui.protocols import Clock, LiveStation, RuleScorer, ShownRules
from pa_console.tui.session_app import SessionApp
from pa_console.tui.widgets.alarms import AlarmPane
from pa_console.tui.widgets.assets import AssetPane
from pa_console.tui.widgets.map_view import MapView
from pa_console.tui.widgets.mission_prompt import MissionPrompt
from pa_console.tui.widgets.row_views import VirtualRows


class BrowsingApp(SessionApp):
    """Carries out the registry's actions that change nothing outside the screen."""

    def __init__(
        self,
        world: World,
        station: LiveStation | None,
        rulebook: ShownRules,
        retriever: RuleScorer,
        *,
        readonly: bool = False,
        player: Player | None = None,
        clock: Clock = time.monotonic,
        copies: Path | None = None,
        evaluations: Path | None = None,
    ) -> None:
        """`copies` and `evaluations` are folders, None the user's own."""
        super().__init__(
            world, station, rulebook, retriever, readonly=readonly, player=player, clock=clock
        )
        self._copies, self._evaluations = copies, evaluations
        self.keys: Mapping[str, str] = {}

    def tell(self, text: str, title: str, bad: bool = False) -> None:
        """Show a notice; its text is never read as markup."""
        self.notify(text, title=title, severity="error" if bad else "information", markup=False)

    def action_view(self, view: str) -> None:
        """Go to a pane."""
        if self.shown is not None:
            self.shown.focus_view(view)

    def action_to_approval(self) -> None:
        """Go to the plan that waits."""
        if self.main is not None:
            while self.screen is not self.main and not self.screen.is_modal:
                self.pop_screen()
            self.main.to_approval()

    def action_to_prompt(self) -> None:
        """Go to the mission field."""
        if self.shown is not None:
            self.shown.query_one(MissionPrompt).take_cursor()

    def action_leave(self) -> None:
        """Leave a field."""
        if self.shown is not None and self.screen is self.shown:
            self.shown.leave_field()

    def action_select_mission(self, by: int) -> None:
        """Show the trace of the mission before or after."""
        if self.shown is not None:
            self.shown.select(self.shown_state, by)

    def action_next_alarm(self) -> None:
        """Put the pointer on the next alarm."""
        if self.shown is not None:
            self.shown.show_alarms().next_alarm()

    def action_next_queued(self) -> None:
        """Put the pointer on the next waiting mission."""
        if self.shown is not None:
            self.shown.show_alarms().next_mission()

    def action_follow(self) -> None:
        """Follow what the alarm at the pointer is about; the same again follows nothing."""
        if self.shown is None:
            return
        view, subject = self.shown.query_one(MapView), self.shown.query_one(AlarmPane).subject
        if not subject or subject == view.followed:
            view.follow("")
        else:
            self.follow(subject)

    def follow(self, name: str) -> None:
        """Keep something in view on the map, and go to the map."""
        if self.shown is not None:
            if self.shown.query_one(MapView).follow(name):
                self.shown.go_to("map")
            else:
                self.tell(f"where {name} is was never reported", "Follow", bad=True)

    def on_virtual_rows_chosen(self, message: VirtualRows.Chosen) -> None:
        """Follow what the chosen row is about."""
        rows = message.rows
        name = rows.subject if isinstance(rows, AlarmPane) else message.key
        if name:
            self.follow(name)

    def action_zoom(self, factor: float) -> None:
        """Zoom the map."""
        if self.shown is not None:
            self.shown.query_one(MapView).zoom_by(factor)

    def action_pan(self, right: int, up: int) -> None:
        """Move the map's view."""
        if self.shown is not None:
            self.shown.query_one(MapView).pan(right, up)

    def action_filter(self) -> None:
        """Type a filter for assets, tracks and cameras."""
        if self.shown is not None:
            self.shown.go_to("assets")
            self.shown.query_one(AssetPane).ask()

    def action_problems(self) -> None:
        """Show only what needs an eye, or everything."""
        if self.shown is not None:
            self.shown.go_to("assets")
            self.shown.query_one(AssetPane).toggle_problems()

    def action_help(self) -> None:
        """Show the help page."""
        from pa_console.tui.screens.help import HelpScreen  # noqa: PLC0415

        self.push_screen(HelpScreen(self.situation, self.keys))

    def action_manual(self) -> None:
        """Show the manual."""
        from pa_console.manual_pages import load_manual  # noqa: PLC0415
        from pa_console.tui.screens.manual import ManualScreen  # noqa: PLC0415

        if not any(isinstance(screen, ManualScreen) for screen in self.screen_stack):
            self.push_screen(ManualScreen(load_manual()))

    def action_evaluation(self) -> None:
        """Show the newest evaluation, or ask for the folder of one."""
        from pa_console.evaluation.runs.run_record import evaluations_folder, newest_evaluation  # noqa: PLC0415
        from pa_console.tui.screens.evaluation import EvaluationScreen  # noqa: PLC0415
        from pa_console.tui.screens.questions import AskFolder  # noqa: PLC0415

        if any(isinstance(screen, EvaluationScreen) for screen in self.screen_stack):
            return

        def show(folder: Path | None) -> None:
            if folder is not None:
                self.push_screen(EvaluationScreen(folder, self.clock))

        below = self._evaluations or evaluations_folder()
        newest = newest_evaluation(below)
        if newest is not None:
            show(newest)
        else:
            question = f"No evaluation below {below} yet: pa-console eval makes one.\nElsewhere?"
            self.push_screen(AskFolder(question), show)

    def action_copy_trace(self) -> None:
        """Copy the shown trace."""
        trace = self.shown.selected(self.shown_state) if self.shown else None
        if trace is not None:
            rules = {rule.id: rule for rule in self.rulebook.rules}
            rules = self.recording.rules if self.recording else rules
            self._copy("trace", f"{trace.mission.id}-trace.txt", trace_text(trace, rules))

    def action_copy_plan(self) -> None:
        """Copy the shown plan."""
        trace = self.shown.selected(self.shown_state) if self.shown else None
        if trace is not None:
            self._copy("plan", f"{trace.mission.id}-plan.json", plan_text(trace))

    def _copy(self, what: str, file: str, text: str) -> None:
        self.copy_to_clipboard(visible(text))
        where = write_copy(self._copies or export_folder(), file, text)
        self.tell(f"{where}, and sent to the terminal's clipboard", f"Copied the {what}")
