"""Line consoles for a session of this station or another; typed lines take effect at once."""

import asyncio
import re
from collections.abc import Callable, Coroutine, Sequence
from contextlib import suppress
from time import monotonic

from pydantic import TypeAdapter

from pa_console.language.orders.order_changes import Change
from pa_console.language.questions import Question
from pa_console.observability import Observer, unobserved
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Decision
from pa_console.station.joined.joined_station import JoinedStation
from pa_console.station.station import ControlStation
from pa_console.terminal.session_lines import LineOutput, SessionLines
from pa_console.terminal.typed_lines import HOW, TypedAnswer, is_answer, read_answer, reason_of
from pa_console.views.waiting import Waiting, behind_line

HELP = """\
Type a mission in plain words, then press Enter. These lines are commands:
  stop              hold every asset at once and void open plans; release ends the stop
  why?              ask about the plan: why Drone_T04? why not the robot? what else could you do?
  approve, reject   decide on the waiting plan; give a reason: reject WHY, approve because WHY
  modify PLAN       replace the plan: ASSET COMMAND; ASSET COMMAND
  reading 1         choose this reading of the order
  show              show the waiting plan again
  mission TEXT      give a mission while a plan waits
  first             start the next mission before the one that waits for your answer
  cancel            cancel the active mission
  status            show time, gates, stop, active mission and queue
  assets, alarms, queue, trace
  standing          list the standing orders; revoke, pause, resume or skip S1
  seen              acknowledge the open alarms
  speed 2           set the simulated seconds per second, 1 to 8
  help, quit"""
CTRL_C = (
    "Ctrl-C does not stop anything. Type stop to hold every asset, or quit to end the session; "
    "otherwise just continue."
)
WAITING_EVERY_S = 5.0
"""The interval, in seconds, between two lines that show what the session is waiting for."""

_SPEED = re.compile(r"(?i)\s*speed\s+(\S+)\s*")
_STANDING = re.compile(r"(?i)\s*(revoke|pause|resume|skip)\s+(s\d+)\s*")
_CHANGE: TypeAdapter[Change] = TypeAdapter(Change)
_MISSION = re.compile(r"(?is)\s*mission\b[\s:]+(\S.*)")
JOINED_HELP = """\
{station} is in command of this session; your questions are answered here.
These lines are commands:
  sign              countersign the waiting plan, if it needs two people
  sign because WHY  countersign it although the judge objects
  show              show the waiting plan again
  stop              ask {station} to stop every asset; needs no signature
  status            show time, gates, stop, active mission and queue
  assets, alarms, queue, trace, standing
  why?              ask about the plan: why Drone_T04? why not the robot? what else could you do?
  take command      put this station in command, after a question; for commanders
  help, quit        leave with quit or Ctrl-C; the session continues"""
_SIGN = re.compile(r"(?is)\s*(sign|countersign|approve)\b(.*)")
_TAKE = re.compile(r"(?i)\s*take\s+(command|over)\s*[.!]*\s*")


class LineConsole(SessionLines):
    """The line console of a station."""

    def __init__(
        self,
        station: ControlStation,
        output: LineOutput,
        waiting: Waiting,
        observer: Observer = unobserved,
    ) -> None:
        """Open the console; `observer` is called with every event."""
        super().__init__(station, output)
        self._station, self.waiting, self._observe = station, waiting, observer
        self._closing: asyncio.Task[None] | None = None
        self._input_ended = False

    def interrupted(self) -> None:
        """Explain that Ctrl-C does not stop anything."""
        self._confirming = None
        self._say(CTRL_C)

    # Events

    def _begin(self) -> None:
        self._say("Type a mission in plain words, then press Enter. For all commands, type help.")

    def _work(self, lines: asyncio.Queue[str | None]) -> Sequence[Coroutine[None, None, None]]:
        return (*super()._work(lines), self._show_waiting())

    def _heed(self, event: ev.Event) -> None:
        self._observe(event)
        self.waiting.take(event, self.state, monotonic())
        match event.data:
            case ev.ApprovalRequested():
                self._ask(event.data)
            case ev.QueueChanged() if line := behind_line(self.state, "first lets it go first"):
                self._say(line)
            case _:
                pass

    def _ask(self, request: ev.ApprovalRequested) -> None:
        """Show the waiting plan and ask for a decision."""
        self._reason, self._confirming = "", None
        if request.state == "not_understood":
            why = "; ".join(request.blocked_by)
            self._say(why)
            self._answer(TypedAnswer(request.decided("reject", reason=why)))
            return
        self._show_request(request)
        if self._input_ended:
            self._reject_unanswered(request)
            return
        self._await_answer()

    def _show_request(self, request: ev.ApprovalRequested) -> None:
        self.show(request, "you", f"Your answer: {HOW}")

    async def _show_waiting(self) -> None:
        """Show from time to time what the session is waiting for."""
        while True:
            await asyncio.sleep(WAITING_EVERY_S)
            if line := self.waiting.line(monotonic(), self.state, self._station.rate):
                self._say(line)

    # Typed lines

    async def _no_more_lines(self) -> None:
        self._say("end of input: the session ends when the active missions have finished")
        self._input_ended = True
        await asyncio.gather(*self._answering)
        if self.request is not None:
            self._reject_unanswered(self.request)
        await self._station.settled()
        await self._station.close("the input has ended")

    def _reject_unanswered(self, request: ev.ApprovalRequested) -> None:
        decision = request.decided("reject", reason="the input has ended")
        self._answer(TypedAnswer(decision))

    def _stop(self) -> None:
        self._station.stop_all()

    def _command(self, line: str) -> bool:
        word = line.casefold()
        speed, standing = _SPEED.fullmatch(line), _STANDING.fullmatch(line)
        if word in ("help", "?"):
            self._say(HELP)
        elif word == "cancel":
            self._station.cancel()
        elif word == "first":
            self._station.let_next_go_first()
        elif word == "release":
            self._confirm("Release the stop and accept missions again? Type yes", self._release)
        elif word == "seen":
            self._seen()
        elif word in ("quit", "exit"):
            self._quit()
        elif speed is not None:
            self._speed(speed[1])
        elif standing is not None:
            change: Change = _CHANGE.validate_python(standing[1].lower())
            self._station.change_standing(standing[2].upper(), change)
        else:
            return False
        return True

    async def _show_answer(self, question: Question) -> None:
        await super()._show_answer(question)
        if self.request is not None:
            self._say(f"The plan is still waiting: {HOW}")

    def _answer_or_order(self, line: str) -> None:
        """Process a line as an answer to the waiting plan, or as a mission."""
        order, request = _MISSION.fullmatch(line), self.request
        if order is not None:
            self._submit(order[1])
            return
        if request is None:
            if is_answer(line):
                self._say("no plan is waiting; to give this as a mission, type mission TEXT")
            else:
                self._submit(line)
            return
        if reason := reason_of(line):
            self._reason = reason
            self._say("reason noted; now approve or reject")
            return
        answer = read_answer(line, request, self._reason)
        if answer is None:
            self._say(f"A plan is waiting: {HOW}. To give another mission, type mission TEXT")
        elif answer.decision is not None and self._too_early:
            self._say("the plan has only just appeared; read it, then answer again")
        else:
            self._answer(answer)

    def _answer(self, answer: TypedAnswer) -> None:
        decision = answer.decision
        if answer.problem:
            self._say(answer.problem)
        elif answer.show and self.request is not None:
            self._show_request(self.request)
        elif decision is not None and answer.confirm:
            self._confirm(answer.confirm, lambda: self._station.decide(decision))
        elif decision is not None:
            self._station.decide(decision)

    def _submit(self, text: str) -> None:
        mission = self._station.submit(text)
        if mission.typed:
            self._say(f"read as: {mission.text}")

    def _release(self) -> None:
        self._station.release()

    def _seen(self) -> None:
        unseen = [item.alarm.id for item in self.state.alarms if not item.acknowledged]
        for name in unseen:
            self._station.acknowledge(name)
        if not unseen:
            self._say("all alarms are acknowledged")

    def _speed(self, text: str) -> None:
        with suppress(ValueError):
            rate = float(text)
            if 1.0 <= rate <= 8.0:
                self._station.rate = rate
                self._say(f"speed {rate:g}")
                return
        self._say("give a speed from 1 to 8")

    def _quit(self) -> None:
        if self.state.active is None:
            self._close()
            return
        question = f"Mission {self.state.active} is active. Cancel it and leave? Type yes"
        self._confirm(question, self._close)

    def _close(self) -> None:
        self._closing = asyncio.create_task(self._station.close())


class JoinedConsole(SessionLines):
    """The line console of a joined session."""

    def __init__(
        self,
        station: JoinedStation,
        output: LineOutput,
        command_question: Callable[[], str] | None = None,
    ) -> None:
        """Open the console.

        `command_question` returns the question to ask before taking command; it is None unless the
        operator is a commander.
        """
        super().__init__(station, output)
        self._station, self._command_question = station, command_question
        self._closing: asyncio.Task[None] | None = None
        self.takes_command = False
        """True if the operator left the session to take command."""

    def interrupted(self) -> None:
        """Leave the session, which continues."""
        self._leave()

    # Events

    def _begin(self) -> None:
        """Show the state of the session; its past events are not repeated."""
        for event in self._station.take_before():
            self.fold(event)
        self._say(f"Joined the session of {self._station.station}. {self._why}")
        self._say("For all commands, type help.")
        self.look("status")
        if (request := self.request) is not None:
            self._ask(request)

    @property
    def _why(self) -> str:
        """The reason why this console is read-only, and the actions that it still allows."""
        station = self._station
        may = ["countersign"] if station.signer else []
        may += ["stop all assets"]
        may += ["take command"] if self._command_question is not None else []
        return (
            f"This console is read-only, because {station.station} is in command. You may "
            f"{' or '.join(may)}."
        )

    def _heed(self, event: ev.Event) -> None:
        match event.data:
            case ev.ApprovalRequested():
                self._ask(event.data)
            case ev.DecisionMade(decision=decision) if decision.signatures:
                self._say(f"signed by {', '.join(decision.signatures)}")
            case _:
                pass

    def _ask(self, request: ev.ApprovalRequested) -> None:
        self._reason, self._confirming = "", None
        self._show(request)
        if not self._refusal(request):
            self._await_answer()

    def _show(self, request: ev.ApprovalRequested) -> None:
        how = self._refusal(request) or "type sign to countersign it, or show to read it again"
        self.show(request, self._station.station, how[:1].upper() + how[1:])

    def _refusal(self, request: ev.ApprovalRequested) -> str:
        """Return why the request cannot be signed here; '' if it can."""
        station = self._station
        if not request.approvals:
            return f"no countersignature is needed; {station.station} decides"
        if request.blocked_by:
            return f"the plan cannot be approved; {station.station} rejects or changes it"
        if not station.signer:
            return "the plan needs two people, but your role may not sign"
        made = self.state.current.decisions if self.state.current is not None else []
        now = [each.decision for each in made if each.attempt == request.attempt]
        if any(station.signer in decision.signatures for decision in now):
            return f"you have signed the plan; {station.station} decides"
        return ""

    # Typed lines

    async def _no_more_lines(self) -> None:
        self._say("end of input: the session is shown until it ends or you press Ctrl-C")

    def _stop(self) -> None:
        self._station.stop_all()
        self._say(f"asked {self._station.station} to stop all assets")

    def _command(self, line: str) -> bool:
        word = line.casefold()
        if _TAKE.fullmatch(line):
            self._take_command()
        elif word in ("help", "?"):
            self._say(JOINED_HELP.format(station=self._station.station))
        elif word in ("quit", "exit"):
            self._leave()
        else:
            return False
        return True

    def _answer_or_order(self, line: str) -> None:
        """Process a line as an answer to the waiting plan; any other line is refused."""
        request = self.request
        signs = _SIGN.fullmatch(line)
        if signs is None and line.casefold() != "show" and not reason_of(line):
            self._say(f"{self._why} For all commands, type help.")
        elif request is None:
            self._say("no plan is waiting")
        elif line.casefold() == "show":
            self._show(request)
        elif reason := reason_of(line):
            self._reason = reason
            self._say("reason noted; now sign")
        elif signs is not None:
            self._countersign(request, signs[2])

    def _countersign(self, request: ev.ApprovalRequested, rest: str) -> None:
        if refusal := self._refusal(request):
            self._say(refusal)
        elif self._too_early:
            self._say("the plan has only just appeared; read it, then answer again")
        elif (answer := read_answer(f"approve {rest}", request, self._reason)) is not None:
            decision = answer.decision
            if decision is None:
                self._say(answer.problem)
            elif answer.confirm:
                self._confirm(
                    answer.confirm.replace("Approve it", "Sign it"), lambda: self._sign(decision)
                )
            else:
                self._sign(decision)

    def _sign(self, decision: Decision) -> None:
        self._station.decide(decision)
        self._say(f"your signature was sent to {self._station.station}")

    def _take_command(self) -> None:
        if self._command_question is None:
            raise ValueError("only a commander may take command")
        self._confirm(f"{self._command_question()}\nTo take command, type yes", self._go)

    def _go(self) -> None:
        self.takes_command = True
        self._leave()

    def _leave(self) -> None:
        self._closing = asyncio.create_task(self._station.close())
