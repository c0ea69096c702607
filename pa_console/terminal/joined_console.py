"""Another station's session as lines: followed, countersigned, stopped, and left at any time."""

import asyncio
import re
from collections.abc import Callable

from pa_console.schema.events import event as ev
from pa_console.schema.mission import Decision
from pa_console.station.joined_station import JoinedStation
from pa_console.terminal.session_lines import LineOutput, SessionLines
from pa_console.terminal.typed_lines import read_answer, reason_of

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


class JoinedConsole(SessionLines):
    """The console of a joined session as lines."""

    def __init__(
        self,
        station: JoinedStation,
        output: LineOutput,
        command_question: Callable[[], str] | None = None,
    ) -> None:
        """Open the console.

        `command_question` is the question before taking command, for a commander; None for others.
        """
        super().__init__(station, output)
        self._station, self._command_question = station, command_question
        self._closing: asyncio.Task[None] | None = None
        self.takes_command = False
        """True if the session was left to take command."""

    def interrupted(self) -> None:
        """Leave at Ctrl-C; the session goes on."""
        self._leave()

    # What happens

    def _begin(self) -> None:
        """Show the state of the session; its past events are not repeated."""
        for event in self._station.take_before():
            self.fold(event)
        self._say(f"Joined the session of {self._station.station}. {self._why}")
        self._say("help says what can be done here.")
        self.look("status")
        if (request := self.request) is not None:
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
        how = self._refusal(request) or "to countersign it: sign; to read it again: show"
        self.show(request, self._station.station, how[:1].upper() + how[1:])

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

    async def _no_more_lines(self) -> None:
        self._say("no more lines can come: the session is followed until it ends, or until Ctrl-C")

    def _stop(self) -> None:
        self._station.stop_all()
        self._say(f"{self._station.station} was asked to stop everybody")

    def _command(self, line: str) -> bool:
        word = line.casefold()
        if _TAKE.fullmatch(line):
            self._take_command()
        elif word in ("help", "?"):
            self._say(HELP.format(station=self._station.station))
        elif word in ("quit", "exit"):
            self._leave()
        else:
            return False
        return True

    def _answer_or_order(self, line: str) -> None:
        """Take a line as an answer to the plan that waits; nothing else is taken here."""
        request = self.request
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
        elif self._too_early:
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

    def _leave(self) -> None:
        self._closing = asyncio.create_task(self._station.close())
