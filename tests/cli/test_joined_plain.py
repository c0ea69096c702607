"""A session that was joined, in lines: what is said of it, what may be typed, and leaving it."""

import asyncio
from collections.abc import AsyncGenerator, Callable
from datetime import UTC, datetime
from typing import cast

import pytest

from pa_console.language.questions import Question
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Decision
from pa_console.station.joined.joined_station import JoinedStation
from pa_console.terminal.line_console import JoinedConsole
from pa_console.terminal.session_lines import LineOutput
from tests.cli.inside import Call
from tests.tui import story

NOW = datetime(2026, 1, 1, tzinfo=UTC)


def event(data: ev.EventPayload) -> ev.Event:
    return ev.Event(t=NOW, tick=1, mission="M001" if data.kind in OF_MISSIONS else None, data=data)


OF_MISSIONS = frozenset(data.kind for data in story.told("approval")) - frozenset(
    ("session_started", "telemetry", "worker", "queue_changed", "worker_changed", "noticed")
)


def waiting(people: int) -> list[ev.Event]:
    """What has happened when a plan waits for so many people."""
    asked = {"observe": people} if people > 1 else {}
    told = [
        data.model_copy(update={"approvals": asked, "needs_override": False, "acknowledge": ()})
        if isinstance(data, ev.ApprovalRequested)
        else data
        for data in story.told("approval")
    ]
    name = next(data.mission.id for data in told if isinstance(data, ev.MissionReceived))
    return [
        each.model_copy(update={"mission": name if each.mission else None})
        for each in map(event, told)
    ]


class North:
    """The session of north, with what has happened `before` and what is fed to it."""

    station = "north"

    def __init__(self, before: list[ev.Event], signer: str = "bob") -> None:
        self.signer, self._before = signer, before
        self.coming = asyncio.Queue[ev.Event | None]()
        self.decisions: list[Decision] = []
        self.stops = 0

    def take_before(self) -> list[ev.Event]:
        """Return what has happened so far."""
        return self._before

    async def run(self) -> AsyncGenerator[ev.Event]:
        """Yield what comes."""
        while (each := await self.coming.get()) is not None:
            yield each

    def decide(self, decision: Decision) -> None:
        """Note a signature."""
        self.decisions.append(decision)

    def stop_all(self) -> None:
        """Note that a stop was asked for."""
        self.stops += 1

    def question_in(self, text: str) -> Question | None:
        """Take what asks why for a question about the plan."""
        return Question(text, "plan") if text.casefold().startswith("why") else None

    async def answer(self, question: Question) -> ev.QuestionAnswered:
        """Say what the test has for an answer."""
        lines = (ev.AnswerLine(about="judge", said="does not object"),)
        return ev.QuestionAnswered(question=question.text, topic=question.topic, lines=lines)

    async def close(self) -> None:
        """Leave."""
        self.coming.put_nowait(None)


class Typist:
    """Types at a joined console and reads what it says."""

    def __init__(self, north: North, question: Callable[[], str] | None = None) -> None:
        self.said: list[str] = []
        self.lines = asyncio.Queue[str | None]()
        self.console = JoinedConsole(
            cast(JoinedStation, north),
            LineOutput(
                self.said.append,
                lambda _trace, _number: self.said.append("PLAN"),
                lambda _trace: self.said.append("TRACE"),
            ),
            question,
        )
        self.running = asyncio.create_task(self.console.run(self.lines))

    async def type(self, line: str) -> str:
        """Return what is said to a line."""
        while not self.said:
            await asyncio.sleep(0)
        count = len(self.said)
        self.lines.put_nowait(line)
        while len(self.said) == count and not self.running.done():
            await asyncio.sleep(0)
        return " ".join(self.said[count:])

    async def leave(self) -> None:
        """Press Ctrl-C."""
        while not self.said:
            await asyncio.sleep(0)
        self.console.interrupted()
        await self.running


async def test_it_says_why_it_is_read_only_and_leaves_at_ctrl_c() -> None:
    one = Typist(North(waiting(1)))
    refused = await one.type("Send a drone to the east gate.")
    assert "This console is read-only, because north is in command" in refused
    assert "sign" in await one.type("help")
    assert "no countersignature is needed; north decides" in await one.type("sign")
    assert "only a commander may take command" in await one.type("take command")
    assert "TRACE" in await one.type("trace")
    assert "time" in await one.type("status")
    await one.leave()
    assert not one.console.takes_command


async def test_what_takes_two_people_is_signed_once_and_stop_needs_no_signature() -> None:
    north = North(waiting(2))
    one = Typist(north)
    assert "your signature was sent to north" in await one.type("sign")
    (decision,) = north.decisions
    assert decision.kind == "approve"
    signed = Decision(kind="approve", by="bob at another station", signatures={"bob": "s"})
    detail = "observe needs 2 people to approve, so far there is 1"
    made = ev.DecisionMade(
        attempt=one.console.state.current.approval.attempt,  # pyright: ignore[reportOptionalMemberAccess]
        decision=signed,
        accepted=False,
        detail=detail,
    )
    waits = one.console.state.current
    assert waits is not None
    north.coming.put_nowait(event(made).model_copy(update={"mission": waits.mission.id}))
    while "signed by bob" not in one.said:
        await asyncio.sleep(0)
    assert f"decision not accepted: {detail}" in one.said
    assert "you have signed the plan; north decides" in await one.type("sign")
    assert "asked north to stop all assets" in await one.type("Stop all!")
    assert (north.stops, len(north.decisions)) == (1, 1)
    await one.leave()


async def test_a_question_is_answered_here_while_the_plan_waits_there() -> None:
    north = North(waiting(2), signer="")
    one = Typist(north)
    for text in ("Why?", "why not Robot_T02"):
        assert await one.type(text) == "judge: does not object"
    assert one.console.state.current is not None
    assert one.console.state.current.approval is not None
    assert (north.decisions, north.stops) == ([], 0)
    await one.leave()


async def test_an_observer_signs_nothing_and_may_stop() -> None:
    north = North(waiting(2), signer="")
    one = Typist(north)
    assert "your role may not sign" in await one.type("sign")
    await one.type("stop")
    assert (north.decisions, north.stops) == ([], 1)
    await one.leave()


@pytest.mark.parametrize(("answer", "takes"), [("yes", True), ("no", False)])
async def test_command_is_taken_after_a_yes_to_what_it_does(answer: str, takes: bool) -> None:
    one = Typist(North(waiting(1)), lambda: "Put south in command in place of north?")
    told = await one.type("take command")
    assert "in place of north?" in told
    assert "To take command, type yes" in told
    await one.type(answer)
    assert one.console.takes_command == takes
    await one.leave()


async def test_what_hinders_a_takeover_is_said() -> None:
    def hindered() -> str:
        raise ValueError("this station is not in the roster")

    one = Typist(North(waiting(1)), hindered)
    assert await one.type("take command") == "this station is not in the roster"
    await one.type("help")
    await one.leave()


def test_its_options_and_its_missing_keys_are_told_as_for_a_screen(call: Call) -> None:
    wrong = call("console", "--join", "mqtt://localhost/x", "--plain", "--readonly")
    assert (wrong.code, "--join can be combined only with" in wrong.err) == (2, True)
    missing = call("console", "--join", "mqtt://localhost/x", "--plain")
    assert (missing.code, "--join needs keys for the site" in missing.said) == (2, True)
