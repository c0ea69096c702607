"""A mission on the terminal: each step as a line, its whole trace, and the question about its plan.

At a terminal, the operator may ask questions such as *Why?* or *Why not the robot?* before
deciding.
"""

import signal
import sys
import termios
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager, suppress
from typing import Any, TypeVar

from rich.console import Console
from rich.padding import Padding
from rich.prompt import Confirm, Prompt, PromptBase
from rich.table import Table
from rich.text import Text

from pa_console.language.canonical.reading import plain_reading
from pa_console.language.questions import Question
from pa_console.mission.approval import people_words
from pa_console.schema.events import event as ev
from pa_console.schema.events.event import ApprovalRequested
from pa_console.schema.events.intake import QuestionAnswered
from pa_console.schema.mission import Decision
from pa_console.schema.text import visible
from pa_console.session.mission_trace import MissionTrace
from pa_console.terminal.output import errors
from pa_console.views.event_words import event_in_words
from pa_console.views.status_words import Tone, status_of
from pa_console.views.trace_layout import answered, headline, lay_out, lay_out_proposal, progress
from pa_console.views.trace_parts import (
    Detail,
    HangingRow,
    Span,
    TraceOptions,
    TraceSection,
    rows_of,
    title_of,
)

_STEPS: dict[str, str] = {
    "mission_received": "mission",
    "standing_order_read": "standing order",
    "standing_order_approved": "in force",
    "standing_order_started": "started",
    "order_step_read": "read",
    "rules_retrieved": "rules found",
    "plan_proposed": "plan",
    "plan_checked": "safeguards",
    "plan_judged": "judge",
    "repair_requested": "planned again",
    "plan_voided": "plan void",
    "command_sent": "sent",
    "command_refused": "refused",
    "plan_halted": "plan halted",
    "steps_held": "not sent",
    "steps_paused": "steps",
    "mission_verified": "telemetry",
    "outcome_judged": "judge on the outcome",
    "mission_preempted": "waits again",
    "mission_finished": "finished",
}
"""The names of the steps that are shown, by kind of event."""
HOW_TO_ASK = "You may also ask: Why?  Why not ASSET?  What would you do instead?"


def step_line(event: ev.Event) -> str:
    """Return `event` in words, as one line; '' if it is not a step of a mission.

    There are also lines for changes of a model's server, and for the model that replaces it.
    """
    match event.data:
        case ev.ServerChanged(state=state) if state != "probing":
            return f"model server: {event_in_words(event.data)}"
        case ev.Noticed(subject="model server", text=text):
            return f"model server: {text}"
        case _:
            pass
    name = _STEPS.get(event.data.kind)
    if name is None or event.mission is None:
        return ""
    words = event_in_words(event.data)
    return f"{event.mission}  {name}: {words}" if words else f"{event.mission}  {name}"


COLOURS: dict[Tone, str] = {
    "": "",
    "good": "green",
    "bad": "red",
    "warn": "yellow",
    "calm": "cyan",
    "quiet": "dim",
    "note": "magenta",
}
"""The terminal's colour for each tone."""

_OPTIONS = TraceOptions(Detail.BRIEF, evidence=True)


def print_trace(console: Console, trace: MissionTrace) -> None:
    """Print the end of a mission, and then its `trace` in the order of the steps."""
    _print_head(console, trace)
    console.print(_text(progress(trace)))
    _print_sections(console, lay_out(trace, {}, _OPTIONS))


def print_choices(console: Console, trace: MissionTrace) -> None:
    """Print the question with which a mission ended, and how to answer it."""
    choices = trace.asked_choices
    console.print(Text(trace.questions[-1].question if choices else "The order could also mean:"))
    for number, choice in enumerate(choices or map(plain_reading, trace.offered), start=1):
        console.print(Text(f"  --choose {number}  {choice}"))


def print_proposal(console: Console, trace: MissionTrace, number: int) -> None:
    """Print the rules and the attempt `number` of a mission that waits for approval."""
    _print_head(console, trace)
    _print_sections(console, lay_out_proposal(trace, number, {}, _OPTIONS))


def print_answer(console: Console, answer: QuestionAnswered) -> None:
    """Print an answer that is about no mission, or about a mission that was printed before."""
    _print_sections(console, answered((answer,)))


def _print_head(console: Console, trace: MissionTrace) -> None:
    console.print()
    for line in headline(trace):
        console.print(_text(line))


def _print_sections(console: Console, sections: Iterable[TraceSection], indent: int = 0) -> None:
    """Print each section under its title, with its parts indented further."""
    for section in sections:
        console.print(Padding(_text(title_of(section)), (0, 0, 0, indent), expand=False))
        for row in rows_of(section):
            console.print(Padding(_hanging(row), (0, 0, 0, indent), expand=False))
        _print_sections(console, section.parts, indent + 2)


def _hanging(row: HangingRow) -> Table:
    """Return a row whose body is wrapped beside its lead."""
    lead = _text(row.lead)
    grid = Table.grid()
    grid.add_column(no_wrap=True, overflow="fold")
    grid.add_column(overflow="fold")
    grid.add_row(lead, _text(row.body))
    return grid


def _text(spans: Iterable[Span]) -> Text:
    """Return spans of text in the terminal's colours, with control characters escaped."""
    return Text.assemble(
        *((visible(span.text), f"{span.stress} {COLOURS[span.tone]}".strip()) for span in spans)
    )


Answer = TypeVar("Answer")
QuestionIn = Callable[[str], Question | None]
"""A function that returns a text as a question about the record; None if it is not one."""


class _AskedError(Exception):
    """The error that is raised when a question is typed instead of an answer."""

    def __init__(self, question: Question) -> None:
        super().__init__(question.text)
        self.question = question


class _AskingBack(PromptBase[Answer]):
    """A prompt at which a question, recognised by `question_in`, may be typed as well."""

    def __init__(self, prompt: str, question_in: QuestionIn, **options: Any) -> None:
        """Pass `options`, such as `choices`, to Rich's prompt."""
        super().__init__(prompt, console=errors, **options)
        self._question_in = question_in

    def process_response(self, value: str) -> Answer:
        """Return the answer; raises _AskedError for a question."""
        if (question := self._question_in(value)) is not None:
            raise _AskedError(question)
        return super().process_response(value)


class _YesOrNo(_AskingBack[bool], Confirm):
    """A prompt for yes or no."""


class _WordsPrompt(_AskingBack[str], Prompt):
    """A prompt for words, or for one of several choices."""


def show_request(request: ApprovalRequested, trace: MissionTrace | None) -> None:
    """Show everything needed to decide on a waiting plan, or the question about the order."""
    if request.state == "not_understood":
        errors.print("; ".join(request.blocked_by), style="bold yellow")
        for number, choice in enumerate(_choices(trace), start=1):
            errors.print(f"  {number}  {choice}")
        return
    if trace is not None:
        print_proposal(errors, trace, request.attempt)
    if request.state in ("narrowed", "may_be_misunderstood"):
        status = status_of("approval", request.state)
        errors.print(status.text, style="bold yellow")
    for reason in request.blocked_by:
        errors.print(f"blocked: {reason}", style="bold red")


def ask_decision(
    request: ApprovalRequested, trace: MissionTrace | None, question_in: QuestionIn = lambda _: None
) -> Decision | Question:
    """Ask for a decision on the shown request; without an answer or a terminal, reject it.

    At a terminal, a question may be typed instead of an answer. It is then returned, and nothing is
    decided.
    """
    if not sys.stdin.isatty():
        return _asked(request, trace, lambda _: None)
    try:
        return _asked(request, trace, question_in)
    except _AskedError as error:
        return error.question


def _asked(
    request: ApprovalRequested, trace: MissionTrace | None, question_in: QuestionIn
) -> Decision:
    if request.state == "not_understood":
        return _answered(request, trace, question_in)
    if request.blocked_by and not request.readings:
        return Decision(kind="reject", reason="; ".join(request.blocked_by))
    if request.approvals:
        reason = f"{people_words(request.approvals)} to approve, and only one is here"
        errors.print(reason, style="bold red")
        return Decision(kind="reject", reason=reason)
    if request.acknowledge:
        errors.print(f"broken rules that you must accept: {', '.join(request.acknowledge)}")
    reason = ""
    _begin_asking()
    try:
        with _interruptible():
            if request.readings and (reading := _chosen_reading(request, question_in)):
                return Decision(kind="choose", asked=reading)
            if request.blocked_by:
                return Decision(kind="reject", reason="; ".join(request.blocked_by))
            if not _YesOrNo("Approve?", question_in)(default=False):
                return Decision(kind="reject", reason="rejected at the terminal")
            while request.needs_override and not reason:
                prompt = "The judge objects. Reason to override it"
                reason = _WordsPrompt(prompt, question_in)().strip()
    except EOFError:
        return Decision(kind="reject", reason="no answer at the terminal")
    return request.approved(reason)


def _answered(
    request: ApprovalRequested, trace: MissionTrace | None, question_in: QuestionIn
) -> Decision:
    """Ask what the order means; without an answer or a terminal, reject it."""
    choices, answer = _choices(trace), ""
    if sys.stdin.isatty():
        _begin_asking()
        hint = "Type a number or your words" if choices else "Type your words"
        hint += ", or press Enter to reject"
        with _interruptible(), suppress(EOFError):
            answer = _WordsPrompt(hint, question_in, show_default=False)(default="").strip()
    if answer.isdigit() and 0 < int(answer) <= len(choices):
        answer = choices[int(answer) - 1]
    if not answer:
        return Decision(kind="reject", reason="; ".join(request.blocked_by))
    return Decision(kind="answer", asked=answer)


def _choices(trace: MissionTrace | None) -> Sequence[str]:
    """Return the possible answers to a question about the order."""
    return trace.choices if trace is not None else ()


def _chosen_reading(request: ApprovalRequested, question_in: QuestionIn) -> str:
    """Ask which reading of the order was meant; '' means the reading that the plan serves."""
    own = f"read as: {plain_reading(request.asked)}; " if request.asked else ""
    errors.print(f"{own}the order could also mean:")
    numbers = [f"{number}" for number, _ in enumerate(request.readings, start=1)]
    for number, reading in zip(numbers, request.readings, strict=True):
        errors.print(f"  {number}  {plain_reading(reading)}")
    question = "Did you mean one of these? 0 for no"
    chosen = _WordsPrompt(question, question_in, choices=["0", *numbers])(default="0")
    return request.readings[int(chosen) - 1] if chosen != "0" else ""


def _begin_asking() -> None:
    """Show, if there is a terminal, which questions may be asked.

    Lines that were typed before the plan was shown are dropped, because they cannot refer to it.
    """
    if sys.stdin.isatty():
        errors.print(HOW_TO_ASK, style="dim")
        termios.tcflush(sys.stdin, termios.TCIFLUSH)


@contextmanager
def _interruptible() -> Generator[None]:
    """Let Ctrl-C end a prompt at once; asyncio's own handler would wait for the answer."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
