"""A station that does nothing but say what the test tells it to, and record what it was told."""

import asyncio
from collections.abc import AsyncGenerator, AsyncIterator, Callable, Iterable
from contextlib import asynccontextmanager
from datetime import timedelta
from pathlib import Path
from typing import Any, NamedTuple, cast

from textual import events
from textual.pilot import Pilot

from pa_console.language.orders.order_changes import Change
from pa_console.language.questions import Question
from pa_console.mission.examine import Examination
from pa_console.policy.retriever import Retriever
from pa_console.schema.events.event import (
    AgentMuted,
    AlarmAcknowledged,
    AllStopped,
    AnswerLine,
    CameraStill,
    DecisionMade,
    Event,
    EventPayload,
    MissionFinished,
    QuestionAnswered,
    StandingOrderRevoked,
    StandingOrderScheduled,
    StopReleased,
)
from pa_console.schema.finding import Finding
from pa_console.schema.incident import Incident
from pa_console.schema.mission import Decision, Metrics, Mission
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import RehearsedReading
from pa_console.schema.world import World
from pa_console.station.answers.alternatives import Alternative
from pa_console.station.station import ControlStation
from pa_console.tui.app import ConsoleApp
from pa_console.tui.controllers.typing import KeyTime
from tests.quick_textual import paint
from tests.tui.site import RULEBOOK, WORLD, WordRetriever
from tests.tui.story import MISSION, START, stamped

SIZE = (120, 36)
LAYOUTS = 5  # what is mounted is laid out, fitted, laid out anew, scrolled to, then drawn


class FakeClock:
    """A clock that stands until the test moves it."""

    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        """Return the time."""
        return self.now


class Deliberate:
    """The time of each key that is pressed: long after the one before, as single keys are."""

    def __init__(self) -> None:
        self._now = 0.0

    def __call__(self, _key: events.Key) -> float:
        """Return when the key was pressed."""
        self._now += 2.0
        return self._now


class ScriptedStation:
    """Yields the events given at the start, then whatever `emit` adds."""

    def __init__(self, payloads: Iterable[EventPayload] = (), broken: str = "") -> None:
        self.rate, self.ground = 1.0, None
        self.submitted: list[str] = []
        self.decisions: list[Decision] = []
        self.pointed = ""
        self.injected: list[Incident] = []
        self.cancelled = self.stopped = self.released = 0
        self.acknowledged: list[str] = []
        self.moved: list[tuple[str, int]] = []
        self.deferred: list[str] = []
        self.let_first = 0
        self.withdrawn: list[str] = []
        self.changed: list[tuple[str, Change]] = []
        self.closed = False
        self.refuse = self.offered = ""
        self.rehearsed: dict[str, RehearsedReading] = {}
        self.findings: tuple[Finding, ...] = ()
        """What every plan that is looked at is found to break."""
        self.ways: list[RehearsedReading] = []
        self.questions: dict[str, Question] = {}
        self.answers: dict[str, tuple[AnswerLine, ...]] = {}
        self.stills: dict[str, CameraStill] = {}
        self.alternatives: list[Alternative] = []
        self.told: list[QuestionAnswered] = []
        self.slow = asyncio.Event()
        """Other ways and answers come once this is set."""
        self.slow.set()
        self.accepted = 0
        self.typed, self.reloads = "", 0
        self.show_reading: Callable[[str, str], None] | None = None
        self.retriever: Retriever = WordRetriever()
        self._broken = broken
        self._queue: asyncio.Queue[Event | None] = asyncio.Queue()
        self._count = 0
        self.given = 0
        for event in stamped(list(payloads)):
            self._queue.put_nowait(event)
            self._count += 1

    async def run(self) -> AsyncIterator[Event]:
        """Yield what was given and what is emitted."""
        while (event := await self._queue.get()) is not None:
            yield event
            self.given += 1
        if self._broken:
            raise RuntimeError(self._broken)

    def emit(self, *payloads: EventPayload, mission: str | None = MISSION.id) -> None:
        """Add events to the stream."""
        for data in payloads:
            self._count += 1
            time = START + timedelta(seconds=self._count)
            self._queue.put_nowait(Event(t=time, tick=4000, mission=mission, data=data))

    def end(self) -> None:
        """End the stream."""
        self._queue.put_nowait(None)

    async def still_of(self, track: str) -> CameraStill | None:
        """Return the picture of a track, as the test has it."""
        return self.stills.get(track)

    @property
    def drained(self) -> bool:
        """Whether everything was taken."""
        return self._queue.empty() and self.given == self._count

    @property
    def rules_offered(self) -> str:
        """Say why the rules of the file wait, as the test has it."""
        return self.offered

    def change_standing(self, order_id: str, change: Change) -> None:
        """Record a change to a standing order, and tell it."""
        self._refuse()
        self.changed.append((order_id, change))
        if change == "revoke":
            self.emit(StandingOrderRevoked(order_id=order_id, by="operator"), mission=None)
            return
        told = StandingOrderScheduled(order_id=order_id, paused=change == "pause", by="operator")
        self.emit(told, mission=None)

    def mute_agent(self, agent: str, *, muted: bool = True) -> None:
        """Mute an agent, or let it propose again."""
        self._refuse()
        self.emit(AgentMuted(agent=agent, muted=muted, by="operator"), mission=None)

    async def accept_rules(self) -> None:
        """Count what was accepted."""
        self._refuse()
        self.accepted += 1
        self.offered = ""

    def point(self, name: str) -> None:
        """Note what is marked."""
        self.pointed = name

    def typing(self, text: str) -> None:
        """Note the text that the prompt told of."""
        self.typed = text

    def read_live(self, show: Callable[[str, str], None] | None) -> None:
        """Give readings to `show`, when the test has one."""
        self.show_reading = show

    def question_in(self, text: str) -> Question | None:
        """Return the question that the test has for a text."""
        return self.questions.get(text)

    async def answer(
        self, question: Question, found: Callable[[Alternative], object] = lambda _: None
    ) -> QuestionAnswered:
        """Tell the answer that the test has for a question, and its alternatives."""
        for each in self.alternatives:
            await self.slow.wait()
            found(each)
        await self.slow.wait()
        told = QuestionAnswered(
            question=question.text,
            topic=question.topic,
            subjects=question.subjects,
            lines=self.answers[question.text],
        )
        self.emit(told)
        self.told.append(told)
        return told

    def submit(self, text: str) -> Mission:
        """Record a mission."""
        self._refuse()
        self.submitted.append(text)
        return Mission(id=f"M-{len(self.submitted):03}", text=text, created=START)

    def decide(self, decision: Decision) -> None:
        """Record a decision, and accept it unless it modifies."""
        self._refuse()
        self.decisions.append(decision)
        if decision.kind != "modify":
            self.emit(DecisionMade(attempt=1, decision=decision, accepted=True))

    async def other_ways(
        self, mission: Mission, asked: str, but: Plan
    ) -> AsyncIterator[RehearsedReading]:
        """Yield the other ways that the test has made up."""
        for found in self.ways:
            await self.slow.wait()
            yield found

    def cancel(self) -> None:
        """Finish the mission."""
        self.cancelled += 1
        self.emit(MissionFinished(status="cancelled", reason="by the operator", metrics=Metrics()))

    def stop_all(self) -> None:
        """Record a stop."""
        self.stopped += 1
        self.emit(AllStopped(by="operator"), mission=None)

    def release(self) -> None:
        """Record a release."""
        self._refuse()
        self.released += 1
        self.emit(StopReleased(by="operator"), mission=None)

    def acknowledge(self, alarm_id: str) -> None:
        """Record that an alarm was seen, and tell it."""
        self._refuse()
        self.acknowledged.append(alarm_id)
        self.emit(AlarmAcknowledged(alarm_id=alarm_id), mission=None)

    def move(self, mission_id: str, by: int) -> None:
        """Record a move in the queue."""
        self._refuse()
        self.moved.append((mission_id, by))

    def defer(self, mission_id: str) -> None:
        """Record a deferred mission."""
        self._refuse()
        self.deferred.append(mission_id)

    def let_next_go_first(self) -> None:
        """Count how often the next mission was to go first."""
        self._refuse()
        self.let_first += 1

    def withdraw(self, mission_id: str) -> None:
        """Record a withdrawn mission."""
        self._refuse()
        self.withdrawn.append(mission_id)

    async def look_at(self, mission: Mission, asked: str) -> RehearsedReading | None:
        """Return the rehearsal that the test has for a reading."""
        assert mission.id == MISSION.id
        return self.rehearsed.get(asked)

    async def examine(self, plan: Plan, _text: str = "") -> Examination:
        """Return what the test has found of any plan."""
        return Examination(plan, self.findings, None, 0.0, 0.0)

    async def foresee(self, text: str) -> str:
        """Return a reading of any order."""
        return f"reads as: {text}"

    @property
    def decided(self) -> list[str]:
        """The kinds of all decisions, in their order."""
        return [decision.kind for decision in self.decisions]

    def _refuse(self) -> None:
        if self.refuse:
            raise ValueError(self.refuse)

    async def reload_rules(self) -> None:
        """Count how often the rules were to be taken anew."""
        self.reloads += 1

    def inject(self, incident: Incident) -> None:
        """Record an incident."""
        self._refuse()
        self.injected.append(incident)

    async def close(self, reason: str = "") -> None:
        """End the stream."""
        self.closed = True
        self.end()


def console(
    station: ScriptedStation | None,
    tmp: Path,
    clock: FakeClock | None = None,
    key_time: KeyTime | None = None,
    world: World = WORLD,
    **options: Any,
) -> ConsoleApp:
    """A console over a scripted station that touches no folder of the user's."""
    app = ConsoleApp(
        world,
        cast("ControlStation | None", station),
        RULEBOOK,
        WordRetriever(),
        clock=clock or FakeClock(),
        key_time=key_time or Deliberate(),
        history=tmp / "history.txt",
        favourites=tmp / "favourites.yaml",
        copies=tmp / "copies",
        drafts=tmp / "drafts",
        **options,
    )
    app.animation_level = "none"
    return app


async def settle(pilot: Pilot[Any]) -> None:
    """Wait until every event was taken, folded and painted; never for a fixed time."""
    app = pilot.app
    assert isinstance(app, ConsoleApp)
    station = app.session.station
    for _ in range(200):
        await pilot.pause()
        if not isinstance(station, ScriptedStation) or station.drained:
            break
    folded = asyncio.Event()
    app.call_later(folded.set)  # behind every event in the application's queue
    await folded.wait()
    app.feed.flush()
    for _ in range(LAYOUTS):
        await pilot.pause()
    paint(app)


async def press(pilot: Pilot[Any], *keys: str) -> None:
    """Press keys one after the other, and wait until all is settled."""
    await pilot.press(*keys)
    await settle(pilot)


async def until(pilot: Pilot[Any], done: Callable[[], object]) -> None:
    """Wait for what other threads do, however long they take."""
    while not done():
        await pilot.pause(0.01)


def notices(app: ConsoleApp) -> list[str]:
    return [notice.message for notice in app._notifications]  # pyright: ignore[reportPrivateUsage]


class Opened(NamedTuple):
    """A console at its first settled picture, and what the test moves it with."""

    app: ConsoleApp
    pilot: Pilot[None]
    station: ScriptedStation
    clock: FakeClock


class Show:
    """Shows consoles that keep their files in a folder of the test's own."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    @asynccontextmanager
    async def __call__(
        self,
        emitted: ScriptedStation | Iterable[EventPayload] | None,
        *,
        size: tuple[int, int] = SIZE,
        clock: FakeClock | None = None,
        keys_by_clock: bool = False,
        **options: Any,
    ) -> AsyncGenerator[Opened, None]:
        """Show a console over a station that has `emitted` events, or over none.

        Keys are pressed deliberately, one long after the other, or else when the clock says.
        """
        if emitted is None or isinstance(emitted, ScriptedStation):
            station = emitted
        else:
            station = ScriptedStation(emitted)
        moving = clock or FakeClock()
        if keys_by_clock:
            options["key_time"] = lambda _key: moving.now  # pyright: ignore
        app = console(station, self._folder, moving, **options)
        async with app.run_test(size=size) as pilot:
            await settle(pilot)
            yield Opened(app, pilot, station or ScriptedStation(), moving)
