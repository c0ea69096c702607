"""Lines typed in a session, which are read in a thread and parsed as answers to a plan."""

import asyncio
import os
import re
import select
import sys
import termios
from dataclasses import dataclass
from threading import Thread

from pydantic import ValidationError

from pa_console.schema.events.event import ApprovalRequested
from pa_console.schema.mission import Decision
from pa_console.schema.plan import Plan

LONGEST = 20_000
"""The largest number of bytes in a line; longer lines are cut."""
HOW = "approve, reject, modify, show or stop; if the judge objects: approve because REASON"
_WORDS = re.compile(r"(?is)\s*(approve|reject|modify|reading|reason|show)\b[\s:,]*(.*)")
_STOP = re.compile(r"(?i)\s*stop(\s+all)?\s*[.!]*\s*")


class InputLines:
    """The lines of standard input, put into `queue` one by one; None marks their end.

    On a terminal, the end of the input (Ctrl-D) is the line `quit`, and reading continues while
    the terminal exists.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.queue: asyncio.Queue[str | None] = asyncio.Queue()
        self._loop, self._file = loop, sys.stdin.fileno()
        self._terminal = sys.stdin.isatty()
        self._ended, self._end = os.pipe()
        self._thread = Thread(target=self._read, name="input", daemon=True)

    def start(self) -> None:
        """Begin to read."""
        self._thread.start()

    def close(self) -> None:
        """Stop reading."""
        os.write(self._end, b".")
        self._thread.join()
        os.close(self._end)
        os.close(self._ended)

    def forget_typed(self) -> None:
        """Drop text that was typed but not sent, because it was meant for another prompt."""
        if self._terminal:
            termios.tcflush(self._file, termios.TCIFLUSH)

    def _read(self) -> None:
        pending = b""
        while self._ended not in select.select([self._file, self._ended], [], [])[0]:
            try:
                read = os.read(self._file, 4096)
            except OSError:
                read = b""
                self._terminal = False
            if not read and self._terminal and os.isatty(self._file):
                self._give("quit")
                continue
            if not read:
                if pending:
                    self._give(pending.decode(errors="replace"))
                self._give(None)
                return
            *lines, pending = (pending + read).split(b"\n")
            pending = pending[:LONGEST]
            for line in lines:
                self._give(line[:LONGEST].decode(errors="replace"))

    def _give(self, line: str | None) -> None:
        self._loop.call_soon_threadsafe(self.queue.put_nowait, line)


@dataclass(frozen=True)
class TypedAnswer:
    """A typed answer: a decision, a question that `yes` must confirm first, or a problem."""

    decision: Decision | None = None
    confirm: str = ""
    problem: str = ""
    show: bool = False


def is_stop(line: str) -> bool:
    """Return whether `line` stops all assets, in any line console and at any prompt."""
    return _STOP.fullmatch(line) is not None


def read_answer(line: str, request: ApprovalRequested, reason: str = "") -> TypedAnswer | None:
    """Return the answer to `request` in `line`; None if the line is not an answer.

    `reason` is the reason that was typed before, in its own line.
    """
    typed = _WORDS.fullmatch(line)
    if typed is None or not is_answer(line):
        return None
    word, rest = typed[1].casefold(), typed[2].strip()
    match word:
        case "approve":
            why = re.sub(r"(?i)^because\b[\s:,]*", "", rest) or reason
            return _approve(request, why)
        case "reject":
            why = re.sub(r"(?i)^because\b[\s:,]*", "", rest) or reason or "rejected by the operator"
            return TypedAnswer(request.decided("reject", reason=why))
        case "reading":
            return _choose(request, rest)
        case "modify":
            return _modify(request, rest, reason)
        case "show":
            return TypedAnswer(show=True)
        case _:
            return TypedAnswer(problem="give the reason in the same line: reason TEXT")


def is_answer(line: str) -> bool:
    """Return whether `line` would be an answer if a plan waited."""
    typed = _WORDS.fullmatch(line)
    return typed is not None and (typed[1].casefold() != "show" or not typed[2].strip())


def reason_of(line: str) -> str:
    """Return the reason in a line that consists of `reason` and a text; '' for any other line."""
    typed = _WORDS.fullmatch(line)
    return typed[2].strip() if typed is not None and typed[1].casefold() == "reason" else ""


def _approve(request: ApprovalRequested, reason: str) -> TypedAnswer:
    if request.blocked_by:
        return TypedAnswer(problem=f"the plan cannot be approved: {'; '.join(request.blocked_by)}")
    if request.needs_override and not reason:
        return TypedAnswer(problem="the judge objects: type approve because REASON, or reject")
    doubts = [f"it breaks {', '.join(request.acknowledge)}"] if request.acknowledge else []
    if request.needs_override:
        doubts.append("the judge objects")
    if request.state == "narrowed":
        doubts.append("it does less than was asked")
    if request.state == "may_be_misunderstood":
        doubts.append("the order may have been misread")
    confirm = f"{' and '.join(doubts)}. Approve it anyway? Type yes" if doubts else ""
    return TypedAnswer(request.approved(reason), confirm[:1].upper() + confirm[1:])


def _choose(request: ApprovalRequested, number: str) -> TypedAnswer:
    if not number.isdecimal() or not 0 < int(number) <= len(request.readings):
        offered = f"choose 1 to {len(request.readings)}" if request.readings else "none is offered"
        return TypedAnswer(problem=f"there is no reading {number!r}; {offered}")
    reading = request.readings[int(number) - 1]
    return TypedAnswer(request.decided("choose", asked=reading))


def _modify(request: ApprovalRequested, text: str, reason: str) -> TypedAnswer:
    if not text:
        now = "; ".join(f"{action.agent} {action.command}" for action in request.plan.actions)
        example = now or "ASSET hold"
        return TypedAnswer(problem=f"type the whole new plan, for example: modify {example}")
    actions: list[dict[str, str]] = []
    for part in filter(None, (part.strip() for part in text.split(";"))):
        agent, _, command = part.partition(" ")
        actions.append({"agent": agent, "command": command.strip()})
    try:
        plan = Plan.model_validate(
            {"reason": reason or "changed by the operator", "actions": tuple(actions)}
        )
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = [str(part) for part in first["loc"] if isinstance(part, int)]
        which = f"action {int(place[0]) + 1}: " if place else ""
        problem = first["msg"].removeprefix("Value error, ")
        return TypedAnswer(problem=f"{which}{problem}; nothing was changed")
    return TypedAnswer(request.decided("modify", plan=plan, reason=reason))
