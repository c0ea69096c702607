"""Passes the operator's decision on a plan to the station, and lets a plan be modified."""

from textual.screen import Screen

from pa_console.orders.plain_words import plain_reading
from pa_console.schema.events.event import ApprovalRequested
from pa_console.schema.mission import Decision
from pa_console.schema.plan import Plan
from pa_console.session.state.mission_trace import MissionTrace
from pa_console.tui.controllers.commands import CommandController
from pa_console.tui.controllers.console_session import ConsoleSession
from pa_console.tui.plan_preview.preview import PlanPreview
from pa_console.tui.widgets.approval import ApprovalPanel

BACK_TO_PROPOSED = "back to the plan as it was proposed"

PlanKey = tuple[str, int]
"""Id of a mission and number of an attempt."""


class ApprovalController:
    """Decides on the plan that waits; drafts of modified plans are kept while the console runs."""

    def __init__(self, session: ConsoleSession, commands: CommandController) -> None:
        self._session, self._commands = session, commands
        self._drafts: dict[PlanKey, str] = {}
        self._editing: tuple[PlanKey, Screen[Plan | None]] | None = None

    def go_to_it(self) -> None:
        """Go to the plan that waits, from any screen that is not modal."""
        app, main = self._session.app, self._session.main
        if main is not None:
            while app.screen is not main and not app.screen.is_modal:
                app.pop_screen()
            main.to_approval()

    def decide(self, decision: Decision) -> None:
        """Pass the decision on; the panel is open again when it was refused."""
        main = self._session.main
        if (
            not self._commands.attempt("Decision", lambda station: station.decide(decision))
            and main
        ):
            main.query_one(ApprovalPanel).refused()

    def look_at(self, asked: str) -> None:
        """Show what another reading of the order would lead to; with '' the plan that waits."""
        self._session.app.run_worker(
            self._look_at(asked), group="reading", exclusive=True, exit_on_error=False
        )

    async def _look_at(self, asked: str) -> None:
        """Rehearse a reading once and show it, unless the plan has changed meanwhile."""
        session, trace = self._session, self._session.state.current
        main, station = session.main, session.station
        request = trace.approval if trace is not None else None
        if main is None or station is None or trace is None or request is None or not asked:
            if main is not None:
                main.look_at("", None)
            return
        found = await station.look_at(trace.mission, asked)
        if trace.approval is not request:
            return
        if found is None:
            main.look_at(asked, None)
            return
        words = plain_reading(asked)
        plan = PlanPreview(session.world, found.plan, found.rehearsal, words)
        main.look_at(asked, plan, found.faults)

    def modify(self) -> None:
        """Open the editor on the waiting plan, or on the draft that was left."""
        trace = self._session.state.current
        if trace is None or trace.approval is None:
            return
        from pa_console.tui.screens.plan_editor import PlanEditor, plan_json  # noqa: PLC0415

        key = trace.mission.id, trace.approval.attempt
        waiting, request_id = trace.approval.plan, trace.approval.request_id
        proposed = _proposed(trace, trace.approval)
        draft = self._drafts.get(key) or plan_json(waiting)
        editor = PlanEditor(plan_json(proposed), draft)
        self._editing = key, editor

        def closed(plan: Plan | None) -> None:
            self._drafts[key], self._editing = editor.draft, None
            if plan == waiting:
                self._session.tell("the plan is as it was, and still waits", "Nothing was changed")
            elif plan is not None:
                back = BACK_TO_PROPOSED if plan == proposed else ""
                self.decide(Decision(kind="modify", request_id=request_id, plan=plan, reason=back))

        self._session.app.push_screen(editor, closed)

    def close_void_editor(self) -> None:
        """Close the editor when its plan no longer waits."""
        if self._editing is None:
            return
        current = self._session.state.current
        waiting = current.approval if current else None
        open_key = (current.mission.id, waiting.attempt) if current and waiting else None
        key, editor = self._editing
        if key != open_key and self._session.app.screen is editor:
            editor.dismiss(None)
            self._session.tell("the plan no longer waits for a decision", "Modify", bad=True)


def _proposed(trace: MissionTrace, request: ApprovalRequested) -> Plan:
    """Return the plan that the planner last proposed, also where the operator's own waits."""
    before = (each for each in reversed(trace.attempts) if each.number <= request.attempt)
    planned = (each.plan for each in before if each.author != "operator" and each.plan is not None)
    return next(planned, request.plan)
