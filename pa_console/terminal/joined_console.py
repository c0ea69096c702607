"""Another station's session as lines: followed, countersigned, stopped, and left at any time."""

import asyncio
import re
from collections.abc import Callable
from contextlib import aclosing
from time import monotonic

from pa_console.schema.events import event as ev
from pa_console.schema.mission import Decision
from pa_console.session.state import MissionTrace, SessionState
from pa_console.station.joined_station import JoinedStation
from pa_console.terminal.session_lines import SessionLines
from pa_console.terminal.typed_lines import AskedLines, is_stop, read_answer, reason_of

HELP = """\
This is the session of {station}: it is commanded there, and what you ask is answered here.
Each of these is a line:
  sign              countersign the plan that waits, where it takes two people
  sign because WHY  the same, where the judge objects
  show              say the plan that waits once more
  stop              ask {station} to stop everybody; that needs no signature
  status            time, gates, stop, the active mission, what waits
  assets, alarms, queue, trace, standing
  why?              why this plan; why Drone_T04? why not the robot? what else could you do?
  take command      put this station in command, after a question; a commander may
  help, quit        quit, or Ctrl-C, leaves; the session goes on"""

_SIGN = re.compile(r"(?is)\s*(sign|countersign|approve)\b(.*)")
_TAKE = re.compile(r"(?i)\s*take\s+(command|over)\s*[.!]*\s*")


class JoinedConsole:
    """Shows the events of a joined session, and carries out typed lines."""

    def __init__(
        self,
        station: JoinedStation,
        say: Callable[[str], None],
        show_plan: Callable[[MissionTrace, int], None],
        show_trace: Callable[[MissionTrace], None],
        *,
        hold_s: float = 0.0,
        called: Callable[[], None] = lambda: None,
        command_question: Callable[[], str] | None = None,
    ) -> None:
        """Open the console.

        `show_plan` and `show_trace` print rows. A signature within `hold_s` seconds of its plan is
        not accepted: the plan cannot have been read. `called` is called when the person here is
        waited for. `command_question` is the question before taking command, for a commander; None
        for others.
        """
        self._station, self._say, self._called = station, say, called
        self._told = SessionLines(say, show_plan, show_trace, called)
        self._hold_s, self._command_question = hold_s, command_question
        self._confirming: Callable[[], None] | None = None
        self._reason, self._shown_at = "", 0.0
        self._closing: asyncio.Task[None] | None = None
        self._asked = AskedLines(station, say)
        self.takes_command = False
        """True if the session was left to take command."""

    @property
    def state(self) -> SessionState:
        """The session as far as it has come here."""
        return self._told.state

    async def run(
        self, lines: asyncio.Queue[str | None], forget: Callable[[], None] = lambda: None
    ) -> None:
        """Follow the session until it ends or is left; `forget` drops what was typed too early."""
        self._forget = forget
        self._begin()
        listening = asyncio.create_task(self._listen(lines))
        try:
            async with aclosing(self._station.run()) as events:
                async for event in events:
                    self._take(event)
                    await asyncio.sleep(0)
        finally:
            listening.cancel()
            await asyncio.gather(listening, return_exceptions=True)

    def interrupted(self) -> None:
        """Leave at Ctrl-C; the session goes on."""
        self._leave()

    # What happens

    def _begin(self) -> None:
        """Show the state of the session; its past events are not repeated."""
        for event in self._station.take_before():
            self._told.fold(event)
        self._say(f"Joined the session of {self._station.station}. {self._why}")
        self._say("help says what can be done here.")
        self._told.look("status")
        if (request := self._told.request) is not None:
            self._ask(request)

    @property
    def _why(self) -> str:
        """The reason why this console is read-only, and the actions possible here."""
        station = self._station
        may = ["countersign"] if station.signer else []
        may += ["stop everybody"]
        may += ["take command"] if self._command_question is not None else []
        return (
            f"Read-only: the session is commanded at {station.station}; here you may "
            f"{' or '.join(may)}."
        )

    def _take(self, event: ev.Event) -> None:
        self._told.take(event)
        match event.data:
            case ev.ApprovalRequested():
                self._ask(event.data)
            case ev.DecisionMade(decision=decision) if decision.signatures:
                self._say(f"signed by {', '.join(decision.signatures)}")
            case _:
                pass
        self._told.tell_notice(event)

    def _ask(self, request: ev.ApprovalRequested) -> None:
        self._reason, self._confirming = "", None
        self._show(request)
        if not self._refusal(request):
            self._forget()
            self._shown_at = monotonic()
            self._called()

    def _show(self, request: ev.ApprovalRequested) -> None:
        how = self._refusal(request) or "to countersign it: sign; to read it again: show"
        self._told.show(request, self._station.station, how[:1].upper() + how[1:])

    def _refusal(self, request: ev.ApprovalRequested) -> str:
        """Return why nothing is signed here, '' where something may be."""
        station = self._station
        if not request.approvals:
            return f"one person is enough: {station.station} decides"
        if request.blocked_by:
            return f"nobody may approve it: {station.station} rejects or changes it"
        if not station.signer:
            return "it takes two people; you may not sign, you have not the role"
        made = self.state.current.decisions if self.state.current is not None else []
        now = [each.decision for each in made if each.attempt == request.attempt]
        if any(station.signer in decision.signatures for decision in now):
            return f"you have signed; {station.station} decides"
        return ""

    # What is typed

    async def _listen(self, lines: asyncio.Queue[str | None]) -> None:
        while (line := await lines.get()) is not None:
            if line.strip():
                self._do(line.strip())
        self._say("no more lines can come: the session is followed until it ends, or until Ctrl-C")

    def _do(self, line: str) -> None:
        """Carry out one line; what is wrong with it is said."""
        confirming, self._confirming = self._confirming, None
        word = line.casefold()
        try:
            if is_stop(line):
                self._station.stop_all()
                self._say(f"{self._station.station} was asked to stop everybody")
            elif confirming is not None and word == "yes":
                confirming()
            elif confirming is not None and word == "no":
                self._say("left as it is")
            elif _TAKE.fullmatch(line):
                self._take_command()
            elif word in ("help", "?"):
                self._say(HELP.format(station=self._station.station))
            elif word in ("quit", "exit"):
                self._leave()
            elif not self._told.look(word) and not self._asked.take(line):
                self._answer(line)
        except ValueError as error:
            self._say(str(error))

    def _answer(self, line: str) -> None:
        """Take a line as an answer to the plan that waits; nothing else is taken here."""
        request = self._told.request
        signs = _SIGN.fullmatch(line)
        if signs is None and line.casefold() != "show" and not reason_of(line):
            self._say(f"{self._why} help says what can be done here.")
        elif request is None:
            self._say("no plan waits")
        elif line.casefold() == "show":
            self._show(request)
        elif reason := reason_of(line):
            self._reason = reason
            self._say("the reason is noted; now sign")
        elif signs is not None:
            self._countersign(request, signs[2])

    def _countersign(self, request: ev.ApprovalRequested, rest: str) -> None:
        if refusal := self._refusal(request):
            self._say(refusal)
        elif monotonic() - self._shown_at < self._hold_s:
            self._say("the plan had just been shown: read it, and answer again")
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
            raise ValueError("only a commander takes command, and you are none")
        self._confirm(f"{self._command_question()}\nType yes to take command", self._go)

    def _go(self) -> None:
        self.takes_command = True
        self._leave()

    def _confirm(self, question: str, do: Callable[[], None]) -> None:
        self._confirming = do
        self._say(question)

    def _leave(self) -> None:
        self._closing = asyncio.create_task(self._station.close())
