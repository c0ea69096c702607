"""Controllers that pass decisions and questions to the station and show its answers."""

from contextlib import suppress
from typing import Any

from textual.screen import Screen

from pa_console.language.canonical.reading import plain_reading
from pa_console.language.questions import Question
from pa_console.mission.examine import Examination
from pa_console.schema.events.event import ApprovalRequested
from pa_console.schema.mission import Decision
from pa_console.schema.plan import Plan
from pa_console.schema.world import World
from pa_console.session.mission_trace import MissionTrace
from pa_console.station.answers.alternatives import Alternative
from pa_console.station.answers.answering import NO_OTHER
from pa_console.station.answers.why import attempt_of
from pa_console.tui.approval.comparison import (
    MOST_BESIDE,
    ComparedPlan,
    PlanComparison,
    canonical_reading,
    other_reading,
    other_way,
    past_candidate,
    waiting_candidate,
)
from pa_console.tui.approval.panel import ApprovalPanel
from pa_console.tui.controllers.commands import CommandController
from pa_console.tui.controllers.console_session import ConsoleSession
from pa_console.tui.plan_preview import PlanPreview, waiting_plan
from pa_console.tui.screens.answer import AnswerScreen
from pa_console.tui.widgets.mission_prompt import MissionPrompt

CHOOSE = "Alt+1 to Alt+3 select a plan; Enter chooses it, to be checked and proposed"
ORDER = "Alt+1 to Alt+3 select a plan; Enter types an order for it and sends nothing"
BACK_TO_PROPOSED = "back to the plan as it was proposed"

PlanKey = tuple[str, int]
"""The id of a mission and the number of an attempt."""


class ApprovalController:
    """A controller for decisions on waiting plans; it keeps drafts until the console closes."""

    def __init__(self, session: ConsoleSession, commands: CommandController) -> None:
        self._session, self._commands = session, commands
        self._drafts: dict[PlanKey, str] = {}
        self._editing: tuple[PlanKey, Screen[Plan | str | None]] | None = None
        self._comparing: tuple[str, PlanComparison] | None = None
        self._foreseen = ""
        """The id of the last request whose timed order was planned ahead."""

    def go_to_it(self) -> None:
        """Focus the waiting plan, from any screen that is not modal."""
        app, main = self._session.app, self._session.main
        if main is not None:
            while app.screen is not main and not app.screen.is_modal:
                app.pop_screen()
            main.query_one(ApprovalPanel).take_focus()

    def decide(self, decision: Decision) -> None:
        """Send the decision to the station; if it is refused, the panel accepts decisions again."""
        main = self._session.main
        if (
            not self._commands.attempt("Decision", lambda station: station.decide(decision))
            and main
        ):
            main.query_one(ApprovalPanel).refused()

    def look_at(self, asked: str) -> None:
        """Show the consequences of another reading of the order; with '', show the waiting plan."""
        self._session.app.run_worker(
            self._look_at(asked), group="reading", exclusive=True, exit_on_error=False
        )

    def compare(self, question: Question | None = None) -> bool:
        """Show other plans beside the waiting one, each as soon as it is found.

        With a `question`, the other plans are its answer; if no plan waits, they are shown beside
        the mission's last plan. Returns whether there is a plan to compare.
        """
        session, trace = self._session, self._session.state.current
        request = trace.approval if trace is not None else None
        first = _compared_with(session.world, trace, over=question is not None)
        if trace is None or first is None or (request is None and question is None):
            if question is None:
                session.tell("there is no plan to compare", "Compare")
            return False
        app = session.app

        def ended() -> None:
            self._comparing = None
            app.workers.cancel_group(app, "comparison")

        def begin(screen: PlanComparison) -> None:
            looking = (
                self._answer(screen, question, request)
                if question is not None
                else self._compare(screen, trace, request)
            )
            app.run_worker(looking, group="comparison", exclusive=True, exit_on_error=False)

        screen = PlanComparison(first, begin, ended)
        if request is not None:
            self._comparing = request.request_id, screen
        app.push_screen(screen, self._chosen)
        return True

    def _chosen(self, candidate: ComparedPlan | None) -> None:
        """Submit the chosen plan; if no plan waits, only type the order for it."""
        if candidate is None:
            return
        if candidate.decision is not None:
            self.decide(candidate.decision)
        elif candidate.order and self._session.main is not None:
            self._session.main.query_one(MissionPrompt).put(candidate.order)

    async def _answer(
        self, screen: PlanComparison, question: Question, request: ApprovalRequested | None
    ) -> None:
        """Add the plans that answer a question to the screen, each as soon as it is rehearsed."""
        station, world = self._session.station, self._session.world
        if station is None:
            return

        def add(alternative: Alternative) -> None:
            number = len(screen.columns)
            if alternative.sort == "reading" and request is not None:
                name = request.request_id
                screen.add(other_reading(number, alternative.asked, alternative.found, world, name))
            else:
                name = request.request_id if request is not None else None
                screen.add(other_way(number, alternative.asked, alternative.found, world, name))

        await station.answer(question, add)
        if len(screen.columns) == 1:
            screen.tell(NO_OTHER)
        else:
            screen.tell(CHOOSE if request is not None else ORDER)

    async def _compare(
        self, screen: PlanComparison, trace: MissionTrace, request: ApprovalRequested | None
    ) -> None:
        """Rehearse plans for other readings, then other ways, and add each plan to the screen."""
        station, world = self._session.station, self._session.world
        if station is None or request is None:
            return
        shown, asked = 0, canonical_reading(trace)
        for reading in request.readings:
            screen.tell(f"rehearsing: {plain_reading(reading)}; Esc stops")
            rehearsed = await station.look_at(trace.mission, reading)
            if rehearsed is not None:
                shown += 1
                screen.add(other_reading(shown, reading, rehearsed, world, request.request_id))
        ways = station.other_ways(trace.mission, asked, request.plan)
        while shown < MOST_BESIDE and asked:
            screen.tell(f"rehearsing another way to {plain_reading(asked)}; Esc stops")
            rehearsed = await anext(ways, None)
            if rehearsed is None:
                break
            shown += 1
            screen.add(other_way(shown, asked, rehearsed, world, request.request_id))
        screen.tell(CHOOSE if shown else NO_OTHER)

    async def _look_at(self, asked: str) -> None:
        """Rehearse a reading once and show it, unless the plan has changed meanwhile."""
        session, trace = self._session, self._session.state.current
        main, station = session.main, session.station
        request = trace.approval if trace is not None else None
        if main is None or station is None or trace is None or request is None or not asked:
            if main is not None:
                main.look_at("", None)
            return
        rehearsed = await station.look_at(trace.mission, asked)
        if trace.approval is not request:
            return
        if rehearsed is None:
            main.look_at(asked, None)
            return
        words = plain_reading(asked)
        plan = PlanPreview(session.world, rehearsed.plan, rehearsed.rehearsal, words)
        main.look_at(asked, plan, rehearsed.faults)

    def modify(self, *, as_json: bool = False) -> None:
        """Open the form for the waiting plan or its draft; with `as_json`, open the JSON editor."""
        trace, station = self._session.state.current, self._session.station
        if trace is None or trace.approval is None or station is None:
            return
        from pa_console.tui.screens.plan_editing import PlanEditor, PlanForm, plan_json  # noqa: PLC0415

        key, text = (trace.mission.id, trace.approval.attempt), trace.mission.text
        waiting, request_id = trace.approval.plan, trace.approval.request_id
        proposed = _proposed(trace, trace.approval)
        draft = self._drafts.get(key) or plan_json(waiting)

        async def examine(plan: Plan) -> Examination:
            return await station.examine(plan, text)

        editor: PlanForm | PlanEditor = PlanEditor(plan_json(proposed), draft)
        if not as_json:
            with suppress(ValueError):  # a draft that does not fit the form stays JSON
                editor = PlanForm(self._session.world, plan_json(proposed), draft, examine)
        self._editing = key, editor

        def closed(plan: Plan | str | None) -> None:
            self._drafts[key], self._editing = editor.draft, None
            if isinstance(plan, str):
                self.modify(as_json=isinstance(editor, PlanForm))
            elif plan == waiting:
                self._session.tell("the plan is unchanged and still waits", "Nothing was changed")
            elif plan is not None:
                back = BACK_TO_PROPOSED if plan == proposed else ""
                self.decide(Decision(kind="modify", request_id=request_id, plan=plan, reason=back))

        self._session.app.push_screen(editor, closed)

    def look_ahead(self) -> None:
        """Plan a timed order that waits for approval, once, as if it started now."""
        trace, session = self._session.state.current, self._session
        request = trace.approval if trace is not None else None
        order = request.standing if request is not None else None
        if request is None or order is None or not order.once or session.player is not None:
            return
        if request.request_id != self._foreseen and session.station is not None:
            self._foreseen = request.request_id
            work = self._look_ahead(request.request_id, order.order)
            session.app.run_worker(work, group="foreseen", exclusive=True, exit_on_error=False)

    async def _look_ahead(self, request_id: str, order: str) -> None:
        session = self._session
        line = await session.station.foresee(order) if session.station is not None else ""
        if line and session.main is not None:
            session.main.query_one(ApprovalPanel).tell_foreseen(request_id, line)

    def close_void(self) -> None:
        """Close the editor and the comparison of a plan that no longer waits."""
        current = self._session.state.current
        waiting = current.approval if current else None
        key = (current.mission.id, waiting.attempt) if current and waiting else None
        over: list[tuple[Screen[Any], str]] = []
        if self._comparing and (waiting is None or waiting.request_id != self._comparing[0]):
            over.append((self._comparing[1], "Compare"))
        if self._editing and self._editing[0] != key:
            over.append((self._editing[1], "Modify"))
        for screen, title in over:
            if self._session.app.screen is screen:
                screen.dismiss(None)
                self._session.tell("the plan no longer waits for a decision", title, bad=True)


def _compared_with(world: World, trace: MissionTrace | None, *, over: bool) -> ComparedPlan | None:
    """Return the waiting plan, or, if none waits and `over` is True, the mission's last plan."""
    waits = waiting_plan(world, trace) if trace is not None else None
    if trace is None or waits is not None:
        return waiting_candidate(trace, waits) if trace is not None and waits is not None else None
    attempt = attempt_of(trace) if over and trace.approval is None else None
    return past_candidate(trace, attempt, world) if attempt is not None else None


def _proposed(trace: MissionTrace, request: ApprovalRequested) -> Plan:
    """Return the plan that the planner proposed last, even if the operator's own plan waits."""
    before = (attempt for attempt in reversed(trace.attempts) if attempt.number <= request.attempt)
    planned = (
        attempt.plan
        for attempt in before
        if attempt.author == "planner" and attempt.plan is not None
    )
    return next(planned, request.plan)


class QuestionController:
    """A controller for texts sent at the prompt: a question is answered, other text is a mission.

    If a question asks for other plans and one of them can be chosen, they are shown side by side.
    """

    def __init__(
        self, session: ConsoleSession, commands: CommandController, approval: ApprovalController
    ) -> None:
        self._session, self._commands, self._approval = session, commands, approval

    def take(self, text: str) -> None:
        """Answer a question, or submit a mission."""
        station, main = self._session.station, self._session.main
        question = None
        if station is not None and main is not None and self._session.asks:
            self._commands.point()
            question = station.question_in(text)
        if question is None or main is None:
            self._commands.submit(text)
            return
        main.query_one(MissionPrompt).taken(text)
        beside = question.topic == "alternatives" and not self._session.readonly
        if beside and self._approval.compare(question):
            return
        self._ask(question)

    def _ask(self, question: Question) -> None:
        """Open a screen for the answer, which is shown as soon as it is ready."""
        current = self._session.state.current
        waits = current is not None and current.approval is not None
        screen = AnswerScreen(question.text, waits=waits)
        self._session.app.push_screen(screen)
        self._session.app.run_worker(
            self._answer(question, screen), group="question", exclusive=True, exit_on_error=False
        )

    async def _answer(self, question: Question, screen: AnswerScreen) -> None:
        station = self._session.station
        if station is not None:
            answer = await station.answer(question)
            screen.show(answer)
