"""Asks the operator on the terminal about a plan, after showing what decides about it."""

import signal
import sys
import termios
from collections.abc import Generator
from contextlib import contextmanager, suppress

from rich.prompt import Confirm, Prompt

from pa_console.cli.mission.trace import print_proposal
from pa_console.cli.output import errors
from pa_console.orchestrator.planning.approval import people_words
from pa_console.orders.plain_words import plain_reading
from pa_console.schema.events.event import ApprovalRequested
from pa_console.schema.mission import Decision
from pa_console.session.state.mission_trace import MissionTrace
from pa_console.session.status_words import status_of


def ask_decision(request: ApprovalRequested, trace: MissionTrace | None) -> Decision:
    """Show the rules, the plan and the verdict and ask; no answer, or no terminal, rejects."""
    if request.state == "not_understood":
        return _answered(request, trace)
    if trace is not None:
        print_proposal(errors, trace, request.attempt)
    if request.state in ("narrowed", "may_be_misunderstood"):
        told = status_of("approval", request.state)
        errors.print(told.text, style="bold yellow", markup=False)
    for reason in request.blocked_by:
        errors.print(f"blocked: {reason}", style="bold red", markup=False)
    if request.blocked_by and not request.readings:
        return Decision(kind="reject", reason="; ".join(request.blocked_by))
    if request.approvals:
        told = f"{people_words(request.approvals)} to approve, and here is one"
        errors.print(told, style="bold red", markup=False)
        return Decision(kind="reject", reason=told)
    if request.acknowledge:
        errors.print(f"broken, to be acknowledged: {', '.join(request.acknowledge)}", markup=False)
    reason = ""
    _forget_typed()
    try:
        with _interruptible():
            if request.readings and (asked := _what_was_meant(request)):
                return Decision(kind="choose", asked=asked)
            if request.blocked_by:
                return Decision(kind="reject", reason="; ".join(request.blocked_by))
            if not Confirm.ask("Approve?", console=errors, default=False):
                return Decision(kind="reject", reason="rejected at the terminal")
            while request.needs_override and not reason:
                why = "The judge said Failure. Reason for overriding it"
                reason = Prompt.ask(why, console=errors).strip()
    except EOFError:
        return Decision(kind="reject", reason="nobody answered at the terminal")
    return Decision(
        kind="approve",
        reason=reason,
        override_judge=request.needs_override,
        acknowledged=request.acknowledge,
    )


def _answered(request: ApprovalRequested, trace: MissionTrace | None) -> Decision:
    """Ask what the order means; without an answer, or a terminal, it is rejected."""
    errors.print("; ".join(request.blocked_by), style="bold yellow", markup=False)
    choices = trace.choices if trace is not None else ()
    for number, choice in enumerate(choices, start=1):
        errors.print(f"  {number}  {choice}", markup=False)
    answer = ""
    if sys.stdin.isatty():
        _forget_typed()
        hint = "A number, or in words; Enter for none" if choices else "In words; Enter for none"
        with _interruptible(), suppress(EOFError):
            answer = Prompt.ask(hint, console=errors, default="", show_default=False).strip()
    if answer.isdigit() and 0 < int(answer) <= len(choices):
        answer = choices[int(answer) - 1]
    if not answer:
        return Decision(kind="reject", reason="; ".join(request.blocked_by))
    return Decision(kind="answer", asked=answer)


def _what_was_meant(request: ApprovalRequested) -> str:
    """Ask which reading of the order was meant; '' for the one that was planned for."""
    own = f"read as: {plain_reading(request.asked)}; " if request.asked else ""
    errors.print(f"{own}the order may also mean:", markup=False)
    numbers = [f"{number}" for number, _ in enumerate(request.readings, start=1)]
    for number, asked in zip(numbers, request.readings, strict=True):
        errors.print(f"  {number}  {plain_reading(asked)}", markup=False)
    question = "Was one of these meant? 0: no"
    chosen = Prompt.ask(question, console=errors, choices=["0", *numbers], default="0")
    return request.readings[int(chosen) - 1] if chosen != "0" else ""


def _forget_typed() -> None:
    """Drop what was typed before the plan was on screen: it cannot have been meant for it."""
    if sys.stdin.isatty():
        termios.tcflush(sys.stdin, termios.TCIFLUSH)


@contextmanager
def _interruptible() -> Generator[None]:
    """Let Ctrl-C end a question at once; asyncio's own handler would wait for the answer."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
