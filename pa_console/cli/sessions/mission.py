"""The session of `pa-console mission`: a station without a screen, its log, and its result."""

import errno
import signal
import sys
from collections.abc import Awaitable, Sequence
from dataclasses import replace
from pathlib import Path
from time import monotonic

import typer
from pydantic import TypeAdapter, ValidationError

from pa_console.cli.options import SessionOptions
from pa_console.cli.sessions.live import open_live
from pa_console.cli.sessions.log import report_witness_problem, usual_file
from pa_console.cli.sessions.observing import Beside
from pa_console.end_signals import EndableRun, exit_code_of, leave_terminal
from pa_console.llm.local.engine import Engine
from pa_console.llm.models.catalogue import find_model
from pa_console.llm.remote.servers import Servers, session_models
from pa_console.mission.approval import ApprovalMode, standing_approver
from pa_console.observability import Observer
from pa_console.schema.document import Document
from pa_console.schema.events.event import (
    ApprovalRequested,
    Event,
    MissionFinished,
    QuestionAnswered,
)
from pa_console.schema.incident import Incident
from pa_console.schema.mission import Decision, DecisionKind
from pa_console.schema.text import count
from pa_console.session.log.chain import LogError
from pa_console.session.log.writer import LogWriter
from pa_console.session.mission_trace import MissionTrace
from pa_console.session.state import SessionState
from pa_console.settings.schema import Settings
from pa_console.station.headless import EXIT_CODES, Approver, exit_code, run_missions
from pa_console.station.station import ControlStation
from pa_console.terminal.mission import (
    ask_decision,
    print_answer,
    print_choices,
    print_trace,
    show_request,
    step_line,
)
from pa_console.terminal.output import BAD_INPUT, errors, out, print_json
from pa_console.views.trace_layout import step_name
from pa_console.views.waiting import Waiting, load_usual, save_usual

ASKED_BACK = 5
"""The exit code of a mission that ended with a question to the operator."""


def run_mission(
    options: SessionOptions,
    settings: Settings,
    beside: Beside,
    text: str | None,
    *,
    standing: ApprovalMode | None,
    override_reason: str,
    setup: Sequence[str],
    choose: int = 0,
    json: bool,
) -> None:
    """Run the missions of the verb; raises typer.Exit with the exit code.

    `setup` has the incidents before the missions, as YAML. Without a `standing` instruction, the
    user at the terminal decides on the plan. If the order leads to a question, the choice with the
    number `choose` is taken, unless that is 0.
    """
    if text is None and options.scenario is None:
        raise ValueError("give a mission in plain language, --scenario NAME, or both")
    incidents = [read_event(number, event) for number, event in enumerate(setup, start=1)]
    chosen = session_models(options.model, settings.judge_server, settings.second_reader)
    opened = open_live(
        options,
        settings,
        lambda: Engine(
            find_model(chosen.own, second_reader=chosen.second_reader),
            require_sandbox=options.require_sandbox,
        ),
        Servers.open(
            chosen.named, plain=settings.plain_servers, patience_s=settings.server_patience_s
        ),
    )
    station, writer = opened.station, opened.open_log()
    endable = EndableRun()
    progress = _Progress(station, writer, endable, opened.engine.model.sha256, beside.observer)
    approver: Approver = (
        progress.ask
        if standing is None
        else standing_approver(standing, override_reason, least=settings.standing_confidence)
    )
    if choose:
        approver = _choosing(progress, approver, choose)
    unlogged: LogError | None = None
    try:
        with opened.logged(writer, endable.end), progress:
            station.listen_to(beside.outside)
            endable.run(
                run_missions(
                    station,
                    [text] if text is not None else [],
                    approver,
                    progress.show,
                    incidents,
                    duration_s=opened.duration_s,
                )
            )
    except LogError as error:
        unlogged = error
    except OSError as error:
        if not endable.ended_by and error.errno != errno.EIO:  # the terminal is gone
            raise
        endable.ended_by = endable.ended_by or signal.SIGHUP
        leave_terminal()
    path, single = writer.path, options.scenario is None
    if endable.ended_by:
        errors.print_line(f"the session was ended; log: {path}")
        raise typer.Exit(exit_code_of(endable.ended_by))
    report_witness_problem(writer)
    _print_end(progress.traces, progress.answers, path, unlogged, single=single, json=json)


def _print_end(
    traces: Sequence[MissionTrace],
    answers: Sequence[QuestionAnswered],
    path: Path,
    unlogged: LogError | None,
    *,
    single: bool,
    json: bool,
) -> None:
    """Print the results of the missions; raises typer.Exit with the exit code, or `unlogged`."""
    code = exit_code([trace.status for trace in traces]) if unlogged is None else BAD_INPUT
    open_questions = [trace for trace in traces if _is_asked_back(trace)]
    if code == EXIT_CODES["held"] and open_questions:
        code = ASKED_BACK
    if json:
        document = {"mission": traces[0]} if single and len(traces) == 1 else {"missions": traces}
        if answers:
            document = {"answer": answers[0], **({} if single and not traces else document)}
        problem = {} if unlogged is None else {"log_problem": str(unlogged)}
        print_json({"exit_code": code, "log": str(path), **problem, **document})
    if unlogged is not None:
        raise unlogged
    if not json:
        for answer in answers:
            print_answer(out, answer)
        for trace in traces:
            print_trace(out, trace)
        for trace in open_questions:
            print_choices(out, trace)
        if not traces and not answers:
            out.print("no alarm needed a response")
        out.print_line(f"log: {path}")
    raise typer.Exit(code)


def _is_asked_back(trace: MissionTrace) -> bool:
    """Return whether the mission ended with a question that no person was there to answer."""
    if trace.status not in ("held", "rejected"):
        return False
    decision = trace.decision
    unattended = not sys.stdin.isatty() or (decision is not None and decision.standing)
    return unattended and bool(trace.asked_choices or trace.offered)


def _choosing(progress: "_Progress", approver: Approver, number: int) -> Approver:
    """Return an approver that answers the first question with the choice or reading `number`."""
    taken = False

    def decide(request: ApprovalRequested) -> Decision | Awaitable[Decision]:
        nonlocal taken
        trace = progress.state.current
        choices = trace.choices if trace is not None else ()
        offered = choices or request.readings
        if taken or not offered:
            return approver(request)
        taken = True
        if number > len(offered):
            reason = f"--choose {number}: the console offered only {count(len(offered), 'choice')}"
            return request.decided("reject", reason=reason)
        kind: DecisionKind = "answer" if choices else "choose"
        return request.decided(kind, asked=offered[number - 1])

    return decide


def read_event(number: int, text: str) -> Incident:
    """Return the incident of one --event; raises DocumentError with the option and the field."""
    document = Document(f"--event {number}", text)
    try:
        return TypeAdapter[Incident](Incident).validate_python(document.value)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise document.error(first["loc"], first["msg"]) from error


class _Progress:
    """Progress on stderr: each step and, on a terminal, what is being waited for and for how long.

    A session that cannot be logged is ended.
    """

    def __init__(
        self,
        station: ControlStation,
        writer: LogWriter,
        endable: EndableRun,
        model: str,
        observer: Observer,
    ) -> None:
        """Use the usual times of the model with the SHA-256 `model`."""
        self._station = station
        self._shown: list[QuestionAnswered] = []
        """The answers that were already shown on the terminal."""
        self._writer, self._endable, self._model = writer, endable, model
        self._status = errors.status("starting")
        self._waiting = Waiting(load_usual(usual_file(), model))
        self.state = SessionState()
        """The latest state of the session."""
        self._recorded: set[str] = set()
        self.answers: list[QuestionAnswered] = []
        """The answers to questions that have not been shown yet, in order."""
        self._observe = observer

    @property
    def traces(self) -> list[MissionTrace]:
        """All missions; a mission whose end is not in the log counts as not ended."""
        missions = self.state.missions.items()
        return [t if name in self._recorded else replace(t, status=None) for name, t in missions]

    def show(self, event: Event, state: SessionState) -> None:
        """Show one event; raises LogError if the log cannot be written."""
        self.state = state
        self._observe(event)
        if isinstance(event.data, QuestionAnswered) and event.data not in self._shown:
            self.answers.append(event.data)
        finished = event.mission if isinstance(event.data, MissionFinished) else None
        if finished is not None:
            self._writer.flush()
        if self._writer.error is not None:
            raise self._writer.error
        if finished is not None:
            self._recorded.add(finished)
        self._waiting.take(event, state, monotonic())
        if line := step_line(event):
            errors.print_line(line, style="dim")
        self._status.update(self._standing(state))

    def _standing(self, state: SessionState) -> str:
        """Return what the session is waiting for, or else the progress of the mission."""
        trace, worker = state.current, state.worker
        if waiting := self._waiting.line(monotonic(), state):
            return waiting
        if trace is not None:
            attempt = f", attempt {len(trace.attempts)}" if len(trace.attempts) > 1 else ""
            return f"{trace.mission.id}: {step_name(trace)}{attempt}"
        return f"model {worker.state} {worker.detail}" if worker is not None else "starting"

    async def ask(self, request: ApprovalRequested) -> Decision:
        """Return the operator's decision on the terminal; the progress line is hidden meanwhile.

        If the operator asks a question, the question is answered, and the decision is requested
        again.
        """
        self._status.stop()
        show_request(request, self.state.current)
        while True:
            self._status.stop()
            try:
                with self._endable.asking():
                    trace, question_in = self.state.current, self._station.question_in
                    reply = ask_decision(request, trace, question_in)
            finally:
                self._status.start()
            if isinstance(reply, Decision):
                return reply
            self._status.update("looking for the answer")
            answer = await self._station.answer(reply)
            self._shown.append(answer)
            self._status.stop()
            print_answer(errors, answer)
            if not self._station.awaits_decision:
                return Decision(kind="reject", reason="the plan is no longer waiting")

    def __enter__(self) -> None:
        self._status.start()

    def __exit__(self, *_: object) -> None:
        self._status.stop()
        save_usual(usual_file(), self._model, self._waiting.usual)
