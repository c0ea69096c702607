"""An order is read while it is typed: nothing else happens for it before it is sent."""

import asyncio
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pa_console.llm.backend import GenerationEnd, Request
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Usage
from pa_console.schema.incident import FailAsset, Incident, RestoreAsset, SetBattery, SpawnTrack
from pa_console.schema.mission import Decision
from pa_console.station import live_reading
from pa_console.station.assembly import Site, open_station
from pa_console.station.clock import SteppedClock
from pa_console.station.intake import LEAST_LETTERS
from pa_console.station.station import ControlStation
from tests.rig import Rig
from tests.scripted import SUCCESS, ScriptedEngine, plan

EAST = "Send Drone_T04 to the east gate"
WEST = "Send Robot_T01 to the west gate"
PLANS = {
    "east gate": plan(("Drone_T04", "move_to EastGate")),
    "west gate": plan(("Robot_T01", "move_to WestGate")),
}
HOLD = plan(("Drone_T04", "hold"))
TURNS = 12
"""Turns of the event loop that a piece of an answer takes."""


class WordsEngine(ScriptedEngine):
    """Answers by the words of the order, some turns of the event loop later."""

    def __init__(self) -> None:
        super().__init__([HOLD])
        self.asked = 0
        self.waiting: asyncio.Event | None = None
        """An answer comes once this is set, if there is one."""

    async def generate(self, request: Request) -> AsyncGenerator[str | GenerationEnd]:
        """Give the plan for the last order in the prompt, in two pieces."""
        self.asked += 1
        words = request.user.rpartition("Mission")[2].lower()
        answer = next((told for said, told in PLANS.items() if said in words), HOLD)
        if request.role != "planner":
            answer = SUCCESS
        if request.count > 1:
            yield GenerationEnd("", Usage(completion_tokens=2, seconds=2.0), "stop", ())
            return
        for half in (answer[: len(answer) // 2], answer[len(answer) // 2 :]):
            for _ in range(TURNS):
                await asyncio.sleep(0)
            if self.waiting is not None:
                await self.waiting.wait()
            yield half
        yield GenerationEnd(answer, Usage(completion_tokens=2, seconds=2.0), "stop")


@pytest.fixture(autouse=True)
def _no_pause(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_reading, "PAUSE_S", 0.0)


@dataclass
class Console:
    """A station with its events; whatever waits for a decision is rejected."""

    station: ControlStation
    engine: WordsEngine
    events: list[ev.Event] = field(default_factory=list[ev.Event])
    shown: tuple[str, str] = ("", "")
    changed: asyncio.Event = field(default_factory=asyncio.Event)

    def show(self, text: str, reading: str) -> None:
        """Note what is shown."""
        self.shown = text, reading
        self.changed.set()

    async def follow(self) -> None:
        """Take in every event until the session ends."""
        async for event in self.station.run():
            self.events.append(event)
            if isinstance(event.data, ev.ApprovalRequested):
                self.station.decide(Decision(kind="reject"))

    async def read(self) -> None:
        """Wait until a reading is shown."""
        while not self.shown[1]:
            self.changed.clear()
            await self.changed.wait()

    def kinds(self) -> list[str]:
        """Return the kinds of all events but telemetry."""
        return [event.data.kind for event in self.events if event.data.kind != "telemetry"]


@asynccontextmanager
async def opened(
    site: Site, *, live: bool = True, respond: bool = False
) -> AsyncGenerator[Console]:
    engine = WordsEngine()
    station = open_station(site, engine.engine(), SteppedClock(), respond=respond)
    console = Console(station, engine)
    following = asyncio.create_task(console.follow())
    await station.advance(1.0)
    station.read_live(console.show if live else None)
    try:
        yield console
    finally:
        await station.close()
        await following


async def turns(count: int = 30) -> None:
    for _ in range(count):
        await asyncio.sleep(0)


async def test_a_pause_shows_what_the_order_reads_as_and_nothing_is_logged(rig: Rig) -> None:
    async with opened(rig.site) as console:
        before = console.kinds()
        console.station.typing(EAST)
        await console.read()
        assert console.shown == (EAST, "reads as: Drone_T04 to East Gate; gates stay covered")
        assert console.kinds() == before
        assert console.station.worked_on == ""


async def test_an_order_that_has_ended_is_read_without_a_pause(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_reading, "PAUSE_S", 1e6)
    async with opened(rig.site) as console:
        console.station.typing(EAST)
        await turns()
        assert console.engine.asked == 0
        console.station.typing(f"{EAST}.")
        await console.read()
        assert console.shown[0] == f"{EAST}."


async def test_enter_takes_the_finished_work_and_the_log_says_so(rig: Rig) -> None:
    async with opened(rig.site) as console:
        console.station.typing(EAST)
        await console.read()
        asked = console.engine.asked
        mission = console.station.submit(EAST)
        await console.station.settled()
        assert console.engine.asked == asked
        told = [event.data for event in console.events if event.mission == mission.id]
        proposed = next(data for data in told if isinstance(data, ev.PlanProposed))
        assert proposed.plan is not None
        assert proposed.plan.agents == ("Drone_T04",)
        assert 0.0 < proposed.usage.ahead_s <= proposed.usage.seconds == 2.0
        assert any(isinstance(data, ev.PlanChecked) for data in told)


async def test_an_answer_is_taken_once(rig: Rig) -> None:
    async with opened(rig.site) as console:
        console.station.typing(EAST)
        await console.read()
        asked = console.engine.asked
        for _ in range(2):
            console.station.submit(EAST)
            await console.station.settled()
        assert console.engine.asked > asked


async def test_enter_in_the_middle_goes_on_with_the_answer_that_is_being_written(rig: Rig) -> None:
    async with opened(rig.site) as console:
        console.engine.waiting = asyncio.Event()
        console.station.typing(EAST)
        while not console.engine.asked:
            await asyncio.sleep(0)
        mission = console.station.submit(EAST)
        await turns()
        console.engine.waiting.set()
        await console.station.settled()
        proposed = [e.data for e in console.events if isinstance(e.data, ev.PlanProposed)]
        assert [data.plan is not None and data.plan.agents for data in proposed] == [("Drone_T04",)]
        streamed = (e.data for e in console.events if isinstance(e.data, ev.TextStreamed))
        planned = "".join(data.text for data in streamed if data.role == "planner")
        assert planned == PLANS["east gate"]
        assert {e.mission for e in console.events if e.mission} == {mission.id}


async def test_another_text_withdraws_the_reading_and_is_read_itself(rig: Rig) -> None:
    async with opened(rig.site) as console:
        console.station.typing(EAST)
        await console.read()
        console.station.typing(WEST)
        assert console.shown == ("", "")
        await console.read()
        assert console.shown[0] == WEST
        console.station.typing("")
        assert console.shown == ("", "")


async def test_a_picture_that_changes_withdraws_the_reading_and_the_order_is_read_anew(
    rig: Rig,
) -> None:
    async with opened(rig.site) as console:
        console.station.typing(EAST)
        await console.read()
        console.station.inject(FailAsset(asset="Drone_T04"))
        await console.station.advance(3.0)
        await console.read()
        assert console.shown[0] == EAST
        assert "blocked: " in console.shown[1]
        assert "gates stay covered" not in console.shown[1]


@pytest.mark.parametrize(
    "text",
    [
        "",
        "hold",
        "all home",
        "Why did Drone_T04 go there?",
        "What would you do instead?",
    ],
)
async def test_a_short_text_and_a_question_are_not_read(rig: Rig, text: str) -> None:
    async with opened(rig.site) as console:
        console.station.typing(text)
        await turns()
        assert (console.engine.asked, console.shown) == (0, ("", ""))


async def test_what_is_missing_is_said(rig: Rig) -> None:
    async with opened(rig.site) as console:
        console.station.typing("Whenever the moon is full, relieve a drone")
        await console.read()
        assert console.shown[1].startswith("not clear yet: ")


async def test_an_order_that_the_rules_refuse_is_said_to_be_refused(rig: Rig) -> None:
    async with opened(rig.site) as console:
        console.station.typing("Open fire on the vehicle at the west gate")
        await console.read()
        assert console.shown[1].startswith("would be refused: ROE-01")


async def test_a_timed_order_is_read_with_its_time(rig: Rig) -> None:
    async with opened(rig.site) as console:
        console.station.typing("In ten minutes, send Drone_T04 to the east gate.")
        await console.read()
        assert console.shown[1].startswith("reads as: ")
        assert not console.shown[1].startswith("reads as: whenever")
        assert console.kinds().count("mission_received") == 0


async def test_a_standing_order_is_read_and_not_proposed(rig: Rig) -> None:
    async with opened(rig.site) as console:
        console.station.typing("Whenever a gate has no guard, send a drone there.")
        await console.read()
        assert console.shown[1].startswith("reads as: whenever ")
        assert "standing_order_read" not in console.kinds()


@pytest.mark.parametrize("stops", ["stop", "another order", "a question", "another text", "off"])
async def test_what_is_really_asked_for_interrupts_the_reading(rig: Rig, stops: str) -> None:
    async with opened(rig.site) as console:
        console.engine.waiting = asyncio.Event()
        console.station.typing(EAST)
        while not console.engine.asked:
            await asyncio.sleep(0)
        match stops:
            case "stop":
                console.station.stop_all()
            case "another order":
                console.station.submit(WEST)
            case "a question":
                question = console.station.question_in("Why did Drone_T04 go there?")
                assert question is not None
                await console.station.answer(question)
            case "another text":
                console.station.typing("")
            case _:
                console.station.read_live(None)
        console.engine.waiting.set()
        await console.station.settled()
        assert console.shown == ("", "")
        proposed = [e.data for e in console.events if isinstance(e.data, ev.PlanProposed)]
        assert all(data.plan and data.plan.agents == ("Robot_T01",) for data in proposed)


async def test_nothing_is_read_on_a_machine_without_an_idle_core(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    idle = [100.0]
    monkeypatch.setattr(live_reading, "idle_seconds", lambda: idle[0])
    monkeypatch.setattr(live_reading, "NEARLY", float("inf"))
    async with opened(rig.site) as console:
        console.engine.state = "slow"
        console.station.typing(EAST)
        await turns()
        assert console.engine.asked == 0


async def test_a_console_that_only_reads_reads_no_order(site: Site) -> None:
    engine = WordsEngine()
    station = open_station(site, engine.engine(), SteppedClock(), readonly=True)
    station.read_live(lambda _text, _reading: None)
    station.typing(EAST)
    await turns()
    assert engine.asked == 0


Deed = Literal["type", "turns", "read", "enter", "enter and type on", "picture", "track", "stop"]
ORDERS = (EAST, WEST, "Everybody hold your posts please", "Open fire on the west gate now")
INCIDENTS: tuple[Incident, ...] = (
    FailAsset(asset="Drone_T04"),
    RestoreAsset(asset="Drone_T04"),
    SetBattery(asset="Robot_T01", percent=9.0),
    SetBattery(asset="Robot_T01", percent=90.0),
)


class Step(NamedTuple):
    """One thing that happens at the console; `number` chooses which, or how long."""

    deed: Deed
    number: int


STEPS = st.builds(
    Step,
    st.sampled_from(
        ("type", "type", "turns", "turns", "read", "read", "enter", "enter and type on", "picture",
         "track", "stop")
    ),
    st.integers(0, 60),
)  # fmt: skip


async def happen(console: Console, step: Step, text: str) -> str:
    """Let a step happen; return the text that stands in the prompt then."""
    station, number = console.station, step.number
    match step.deed:
        case "type":
            order = ORDERS[number % len(ORDERS)]
            text = order if number % 3 else order[: number // 2]
            station.typing(text)
        case "turns":
            await turns(number)
        case "read":
            await turns(4)
            draft = station._live._draft  # pyright: ignore[reportPrivateUsage]
            if draft is not None:
                await asyncio.wait([draft])
        case "enter" | "enter and type on":
            sent = len(text.strip()) >= LEAST_LETTERS and not station.stopped
            if sent and station.question_in(text) is None:
                station.submit(text)
                text = ""
                station.typing(text)
                if step.deed == "enter and type on":
                    await turns(number)
                    text = ORDERS[number % len(ORDERS)]
                    station.typing(text)
                await station.settled()
        case "picture" | "track":
            incident = INCIDENTS[number % len(INCIDENTS)]
            station.inject(SpawnTrack(gate="WestGate") if step.deed == "track" else incident)
            await station.settled()
            await station.advance(1.0)
            await station.settled()
        case "stop":
            station.stop_all()
            await station.settled()
            station.release()
            await station.settled()
    return text


def told(console: Console) -> list[tuple[Any, ...]]:
    """Return the log without times and costs: what came, what was decided, and what was sent."""
    session = console.station.session[-4:]
    events = [each for each in console.events if each.data.kind not in OFTEN]
    # The beginning of a prompt is read ahead in either case, perhaps not before the session ends,
    # and whoever reads it is told to be ready once more: only the model's changes are compared.
    ready = next(each for each in events if each.data.kind == "worker")
    return [
        (event.data.kind, (event.mission or "").removesuffix(session), *_decisive(event.data))
        for event in events
        if event is ready or event.data != ready.data
    ]


OFTEN = ("telemetry", "text_streamed")
"""How often they come is a matter of time."""


def _decisive(data: ev.EventPayload) -> tuple[Any, ...]:
    match data:
        case ev.MissionReceived(mission=mission):
            return mission.said, mission.text
        case ev.PlanProposed(plan=plan, text=text, confidence=sure):
            return plan, text, sure
        case ev.ApprovalRequested(plan=plan, state=state, readings=readings):
            return plan, state, readings
        case ev.QuestionAsked(question=question):
            return (question,)
        case ev.PlanJudged(verdict=verdict):
            return (verdict,)
        case ev.MissionFinished(status=status):
            return (status,)
        case ev.CommandSent(command=command):
            return (command,)
        case _:
            return ()


@pytest.mark.long
@settings(
    max_examples=100,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(history=st.lists(STEPS, min_size=3, max_size=14))
def test_whatever_is_typed_the_log_is_that_of_the_orders_that_were_sent(
    site: Site, history: list[Step]
) -> None:
    """No event and no command is for a text that was not sent, and no decision differs."""

    async def histories() -> None:
        logs: list[list[tuple[Any, ...]]] = []
        for live in (True, False):
            async with opened(site, live=live, respond=True) as console:
                text = ""
                for step in history:
                    text = await happen(console, step, text)
                await console.station.settled()
            logs.append(told(console))
        assert logs[0] == logs[1]

    asyncio.run(histories())
