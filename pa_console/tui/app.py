"""The operator console: wires the operator's actions to the station, the replay and the screens."""

import asyncio
import sys
import time
from contextlib import suppress
from pathlib import Path

from textual.actions import SkipAction
from textual.binding import Binding
from textual.screen import Screen

from pa_console.schema.mission import Decision
from pa_console.schema.plan import Plan
from pa_console.schema.world import World
from pa_console.session.replay.player import Player
from pa_console.settings.sources import Loaded, load_settings
from pa_console.tui.actions import ACTIONS, bindings, key_text
from pa_console.tui.kept_input import History, history_file
from pa_console.tui.keymap import shown_keys
from pa_console.tui.palette import ConsoleCommands
from pa_console.tui.protocols import Clock, LiveStation, RuleScorer, ShownRules
from pa_console.tui.screens.main import MainScreen
from pa_console.tui.screens.recording import RecordingScreen
from pa_console.tui.settings_app import SettingsApp
from pa_console.tui.terminal import when_hung_up
from pa_console.tui.whatif import next_rate
from pa_console.tui.widgets.approval import ApprovalPanel
from pa_console.tui.widgets.mission_prompt import MissionPrompt

CLOSE_WITHIN_S = 3.0
"""The console leaves after this long even when the session does not end by itself."""

READ_ONLY = "READ-ONLY: every command is refused"


class ConsoleApp(SettingsApp):
    """The console over a live station, or over a player (then everything is refused)."""

    TITLE = "PA Console"
    CSS_PATH = "console.tcss"
    BINDINGS = [
        *bindings(),
        Binding("ctrl+c", "help_quit", show=False, system=True, priority=True),
    ]
    COMMANDS = {ConsoleCommands}

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
        history: Path | None = None,
        copies: Path | None = None,
        evaluations: Path | None = None,
        settings: Loaded | None = None,
        rules_file: Path | None = None,
        drafts: Path | None = None,
    ) -> None:
        """Paths and settings that are None are the user's own, in the platform's folders.

        Rules can be edited in the `rules_file` that they are from. Raises DocumentError for
        settings of the user's that are wrong.
        """
        super().__init__(
            world, station, rulebook, retriever,
            readonly=readonly, player=player, clock=clock, copies=copies, evaluations=evaluations,
        )  # fmt: skip
        self.settings = settings or load_settings()
        self.open_workbench(rules_file, drafts)
        self._history = history
        self._drafts: dict[tuple[str, int], str] = {}
        self._editing: tuple[tuple[str, int], Screen[Plan | None]] | None = None

    def on_mount(self) -> None:
        """Show the screen first; the session starts after the first paint."""
        self.use_theme()
        self.show_first()
        self.call_after_refresh(self._start)

    def show_first(self) -> None:
        """Show the screen that the console begins with."""
        rules = self.rule_texts
        if self.player is not None:
            self.main = RecordingScreen(self.world, rules, self.player, self.clock)
        else:
            mode, closed = ("READ-ONLY", READ_ONLY) if self.readonly else ("LIVE", "")
            kept = self.settings.values.history_kept
            history = History(None if closed else self._history or history_file(), kept)
            self.main = MainScreen(
                self.world, rules, history, closed=closed, mode=mode, clock=self.clock
            )
        self.push_screen(self.main)

    def get_key_display(self, binding: Binding) -> str:
        """Write keys the same way in the footer and in the help."""
        return key_text(binding.key)

    def _start(self) -> None:
        self.use_settings(self.settings)
        self.start_session()
        if sys.__stdin__ is not None and not self.is_headless:
            when_hung_up(sys.__stdin__.fileno(), self._hung_up)

    def _hung_up(self) -> None:
        """Leave without a question: there is nobody left to answer it."""
        if self.is_running:
            self.call_from_thread(self.run_worker, self._close(), exit_on_error=False)

    # Commands to the station

    def on_mission_prompt_typed(self, message: MissionPrompt.Typed) -> None:
        """Let the model read the picture and the words while the mission is being written."""
        if self.station is not None:
            self.station.typing(message.text)

    def on_mission_prompt_given(self, message: MissionPrompt.Given) -> None:
        """Submit a mission; a refused text stays in the field."""
        if self.attempt("Mission", lambda station: station.submit(message.text)) and self.main:
            self.main.query_one(MissionPrompt).taken(message.text)

    def on_approval_panel_decided(self, message: ApprovalPanel.Decided) -> None:
        """Pass the decision on."""
        self._decide(message.decision)

    def _decide(self, decision: Decision) -> None:
        if not self.attempt("Decision", lambda station: station.decide(decision)) and self.main:
            self.main.query_one(ApprovalPanel).refused()

    def on_approval_panel_modify_asked(self) -> None:
        """Open the editor on the waiting plan, or on the draft that was left."""
        trace = self.state.current
        if trace is None or trace.approval is None:
            return
        from pa_console.tui.screens.plan_editor import PlanEditor, plan_json  # noqa: PLC0415

        key = trace.mission.id, trace.approval.attempt
        request_id = trace.approval.request_id
        editor = PlanEditor(plan_json(trace.approval.plan), self._drafts.get(key, ""))
        self._editing = key, editor

        def closed(plan: Plan | None) -> None:
            self._drafts[key], self._editing = editor.draft, None
            if plan is not None:
                self._decide(Decision(kind="modify", request_id=request_id, plan=plan))

        self.push_screen(editor, closed)

    def show_changes(self) -> None:
        """Repaint, and close the editor when its plan no longer waits."""
        super().show_changes()
        current = self.state.current
        waiting = current.approval if current else None
        open_key = (current.mission.id, waiting.attempt) if current and waiting else None
        if self._editing and self._editing[0] != open_key and self.screen is self._editing[1]:
            self.screen.dismiss(None)
            self.tell("the plan no longer waits for a decision", "Modify", bad=True)

    def set_rate(self, rate: float) -> None:
        """Set the speed of the simulation."""
        if self.station is not None and not self.readonly:
            self.station.rate = self.rate = rate
        self.changed(frozenset(("status",)))

    def action_change_rate(self, factor: float) -> None:
        """Go faster or slower."""
        if self.recording is not None:
            self.recording.change_rate(factor)
        else:
            self.set_rate(next_rate(self.rate, factor))

    # Leaving

    def action_leave_console(self) -> None:
        """Leave, after a question when a mission is active."""
        if self.state.active is None or self.player is not None or self.readonly:
            self.run_worker(self._close(), exit_on_error=False)
            return
        from pa_console.tui.screens.questions import Confirm  # noqa: PLC0415

        question = (
            f"Mission {self.state.active} is still active.\n"
            "Leaving ends the session; the mission is cancelled."
        )

        def answered(leave: bool | None) -> None:
            if leave:
                self.run_worker(self._close(), exit_on_error=False)

        self.push_screen(Confirm(question, yes="Leave", no="Stay"), answered)

    def action_help_quit(self) -> None:
        """Say how to leave, over every screen; `^c` copies what is selected and never leaves."""
        if getattr(self.focused, "selected_text", "") or self.screen.get_selected_text():
            raise SkipAction
        leave = next(action for action in ACTIONS if action.action == "leave_console")
        keys = shown_keys(leave, self.settings.values.keys)
        back = "Esc goes back; there " if self.screen.is_modal else ""
        self.tell(
            f"{back}{keys} leaves the console, after a question while a mission is active", "Leave?"
        )

    async def _close(self) -> None:
        if self.station is not None:
            with suppress(Exception):
                await asyncio.wait_for(self.station.close(), CLOSE_WITHIN_S)
        self.exit()
