"""A station for programs, without a screen: it carries out missions and answers questions.

The station is composed of the parts that the console itself uses. The console's settings have no
effect; a program passes its choices as arguments.
"""

import asyncio
from collections.abc import AsyncGenerator, Callable, Mapping
from contextlib import AsyncExitStack, aclosing, asynccontextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

from pydantic import TypeAdapter

from pa_console.fleets.fleet import Fleet, Simulated
from pa_console.language.orders.order_changes import Change
from pa_console.llm.local.engine import Engine
from pa_console.llm.models.catalogue import find_model
from pa_console.llm.remote.servers import NO_SERVERS, Servers, session_models
from pa_console.mission.approval import standing_approver
from pa_console.schema.events import event as ev
from pa_console.schema.incident import Incident
from pa_console.schema.mission import Decision, Metrics, Mission, MissionStatus, Verification
from pa_console.schema.plan import Plan
from pa_console.session.log.chain import LogError
from pa_console.session.log.writer import LogWriter, default_folder, open_session_log
from pa_console.session.state import MissionTrace, SessionState
from pa_console.signing import key_path, load_signer
from pa_console.sim.worlds.scenario_file import open_scenario
from pa_console.station import assembly
from pa_console.station import station as stations
from pa_console.station.answers.answering import NO_QUESTION
from pa_console.station.assembly import Site
from pa_console.station.clock import RealTimeClock, SteppedClock
from pa_console.station.headless import Approver

if TYPE_CHECKING:
    from pa_console.fleets.authorization import Role
    from pa_console.http.served_session import ServedSession
    from pa_console.http.tokens import TokenBook

OnEvent = Callable[[ev.Event, SessionState], None]
"""A function that takes an event and the session's state after it."""

STANDING_CONFIDENCE = 0.9
"""The confidence of planner and judge in their reading, 0 to 1, that `auto_approver` requires."""


def auto_approver(request: ev.ApprovalRequested) -> Decision:
    """Approve a plan if the safeguards and the judge have no objection; otherwise, reject it.

    Warnings are acknowledged. A judge's Failure is never overridden. An order is not carried out if
    planner or judge may have misread it, with a confidence below STANDING_CONFIDENCE.
    """
    approver = standing_approver("auto", least=STANDING_CONFIDENCE, origin="auto_approver")
    return approver(request)


async def leave_to_clients(_: ev.ApprovalRequested) -> Decision:
    """Never decide, so that every plan waits for a client of `Station.served`."""
    await asyncio.Event().wait()
    raise AssertionError("this wait never ends")


@dataclass(frozen=True)
class Served:
    """The address of a served station, and its access tokens."""

    address: str
    """The start of every URL, such as `http://127.0.0.1:40213`; its `/docs` lists the others."""
    tokens: "TokenBook"

    def make_token(self, role: "Role", person: str) -> str:
        """Return a token for `person` that is valid as long as the session is served.

        An `observer` may read; an `operator` and a `commander` may also give missions, decide and
        stop. Raises ValueError for an invalid name.
        """
        return self.tokens.make(person, role, keep=False)


@dataclass(frozen=True)
class Outcome:
    """The end of a mission.

    `status` is `verified` only if telemetry has shown that the plan was carried out. `plan` is the
    last approved plan, or None. `metrics` has the seconds of each stage: execution on the fleet's
    clock, all other stages in wall time.
    """

    mission: Mission
    status: MissionStatus
    reason: str
    plan: Plan | None
    verification: Verification | None
    report: str
    metrics: Metrics | None


class Station:
    """A control station, from `open_station`, that runs while its context lasts.

    Use it in the event loop in which its context was entered.
    """

    def __init__(
        self,
        station: stations.ControlStation,
        open_log: Callable[[], LogWriter],
        approver: Approver,
        on_event: OnEvent | None,
    ) -> None:
        self._station, self._open_log = station, open_log
        self._approver, self._on_event = approver, on_event
        self.state = SessionState()
        """The present state of the session: picture, alarms, queue, missions."""
        self.log: Path | None = None
        """The path of the session's log once it is open."""
        self._ends: dict[str, asyncio.Future[Outcome]] = {}
        self._asking: asyncio.Task[None] | None = None
        self._begun = asyncio.Event()
        self._over: Exception | None = None
        self._context = AsyncExitStack()
        self._emitted = 0
        self._clients: list[ServedSession] = []

    async def __aenter__(self) -> Self:
        """Begin the session; return once the first picture is available."""
        async with AsyncExitStack() as stack:
            writer = stack.enter_context(self._open_log())
            self.log = writer.path
            self._station.write_to(writer)
            stack.push_async_exit(partial(self._end, asyncio.create_task(self._attend())))
            await self._begun.wait()
            self._context = stack.pop_all()
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """End the session: cancel the active mission and bring its assets to safety.

        Outstanding verdicts on outcomes are awaited, unless an error ends the session.
        """
        await self._context.__aexit__(kind, error, traceback)

    async def run_mission(self, text: str) -> Outcome:
        """Plan, check, decide, execute and verify one mission in plain language.

        Waiting missions are carried out by priority, one at a time. If this call is cancelled, the
        mission is cancelled, and assets under way for it go to a safe state. Raises ValueError if
        the station does not accept the mission, and RuntimeError if the session ends first. If the
        approver raises an exception, the plan is rejected, and the exception is raised here, too.
        """
        if self._over is not None:
            raise self._over
        mission = self._station.submit(text)
        end = self._ends[mission.id] = asyncio.get_running_loop().create_future()
        try:
            return await end
        except asyncio.CancelledError:
            self._abandon(mission.id)
            raise
        finally:
            del self._ends[mission.id]

    async def ask(self, question: str) -> ev.QuestionAnswered:
        """Answer a question about the record: *Why?*, *Why not Robot_T02?*, *What else?*.

        The answer is about the waiting plan, or else about the active or last mission. No model is
        used, nothing is decided and no asset moves; the answer is logged. Each of the answer's
        `lines` has its subject in `about` and its text in `said`. Raises ValueError for any other
        text, and RuntimeError if the session is over.
        """
        if self._over is not None:
            raise self._over
        parsed = self._station.question_in(question)
        if parsed is None:
            raise ValueError(NO_QUESTION)
        return await self._station.answer(parsed)

    def inject(self, incident: Mapping[str, object]) -> None:
        """Make an incident happen in a simulated fleet, e.g. a vehicle 60 m from a gate.

        The example is `{"kind": "spawn", "gate": "WestGate", "distance_m": 60.0}`; the manual's
        page on scenarios lists all kinds. Raises ValueError for an invalid incident, and for a
        fleet that is not simulated.
        """
        self._station.inject(TypeAdapter[Incident](Incident).validate_python(incident))

    async def advance(self, seconds: float) -> None:
        """Wait until `seconds` on the fleet's clock have passed."""
        await self._station.advance(seconds)

    async def settled(self) -> None:
        """Wait until no mission is active or waiting, including missions from alarms.

        By then, the judge has given its verdict on every outcome.
        """
        await self._station.settled()

    def change_standing(self, order_id: str, change: Change) -> None:
        """Revoke, pause or resume a standing order, or skip its next scheduled time.

        Raises ValueError if the order is not in force, or if nothing would change.
        """
        self._station.change_standing(order_id, change)

    def take_manual(self, asset: str) -> None:
        """Take manual control of an asset: only the hold of a stop is still sent to it.

        Raises ValueError if the asset is unknown or already under manual control.
        """
        self._station.manual.take(asset, by="program")

    def end_manual(self, asset: str) -> None:
        """End the manual control of an asset, which does not move it.

        Missions that awaited the asset are queued. Raises ValueError if the asset is not under
        manual control.
        """
        self._station.manual.end(asset, by="program")

    def stop_all(self) -> None:
        """Send every asset a hold at once; no mission is accepted until `release`."""
        self._station.stop_all(by="program")

    def release(self) -> None:
        """Release the stop, which moves no asset; raises ValueError if nothing is stopped."""
        self._station.release(by="program")

    @asynccontextmanager
    async def served(self, port: int = 0) -> AsyncGenerator[Served]:
        """Serve this session to other programs in a context, as `pa-console serve` does.

        It listens on `port` of loopback, by default on a free port. Tokens from `pa-console serve
        --make-token` are valid here, too. The approver of the station still decides, and clients
        may decide as well; the first decision counts. The approver `leave_to_clients` leaves all
        decisions to clients. The extra `serve` is required. Raises ValueError if the port cannot be
        used.
        """
        from pa_console.http.connections import listen  # noqa: PLC0415 - with the extra
        from pa_console.http.http_app import serving  # noqa: PLC0415 - FastAPI
        from pa_console.http.served_session import ServedSession  # noqa: PLC0415
        from pa_console.http.tokens import TOKENS_FILE, TokenBook  # noqa: PLC0415

        client = ServedSession(self._station, self.state, lambda: self.log, told=self._emitted)
        tokens = TokenBook(key_path().with_name(TOKENS_FILE))
        if self.log is not None:
            self._station.take_stills(self.log)
        with listen(port) as listening:
            self._clients.append(client)
            try:
                async with serving(client, tokens, listening, _ignore_failed_request) as address:
                    yield Served(address, tokens)
            finally:
                self._clients.remove(client)

    async def _attend(self) -> None:
        """Follow the session to its end, and let the approver decide."""
        try:
            async with aclosing(self._station.run()) as events:
                async for event in events:
                    self.state.apply(event)
                    self._emitted += not event.data.transient
                    for client in self._clients:
                        client.take(event)
                    if self._on_event is not None:
                        self._on_event(event, self.state)
                    self._take(event)
            self._over = RuntimeError(f"the session is over: {self.state.ended}")
        except Exception as error:
            self._over = error
            raise
        finally:
            self._begun.set()
            self._ask_no_more()
            for end in self._ends.values():
                _settle(end, self._over or RuntimeError("the session was cancelled"))

    async def _end(
        self, attending: asyncio.Task[None], kind: type[BaseException] | None, *_: object
    ) -> None:
        await self._station.close("closed by the program", judge_outcomes=kind is None)
        await attending

    def _take(self, event: ev.Event) -> None:
        match event.data:
            case ev.TelemetryReceived():
                self._begun.set()
            case ev.ApprovalRequested():
                self._ask_no_more()
                self._asking = asyncio.create_task(self._ask(event.data, event.mission))
            case ev.DecisionMade(accepted=False, detail=problem) if self._answered:
                self._reject(f"the program's decision cannot be accepted: {problem}")
            case ev.MissionPreempted():
                self._ask_no_more()
            case ev.MissionFinished() if event.mission is not None:
                self._ask_no_more()
                if (end := self._ends.get(event.mission)) is not None:
                    _settle(end, _outcome(self.state.missions[event.mission]))
            case _:
                pass

    async def _ask(self, request: ev.ApprovalRequested, mission: str | None) -> None:
        """Let the approver decide on a plan; reject the plan if the approver or the log fails."""
        try:
            answer = self._approver(request)
            decision = answer if isinstance(answer, Decision) else await answer
            if self._station.awaits_decision:
                named = {"request_id": request.request_id}
                self._station.decide(decision.model_copy(update=named))
        except Exception as error:
            self._reject(f"the program's approver failed: {type(error).__name__}: {error}")
            if mission is not None and (end := self._ends.get(mission)) is not None:
                _settle(end, error)

    def _reject(self, reason: str) -> None:
        if self._station.awaits_decision:
            self._station.decide(Decision(kind="reject", by="program", reason=reason))

    @property
    def _answered(self) -> bool:
        """True once the approver has decided; until then, a decision comes from a client."""
        return self._asking is None or self._asking.done()

    def _ask_no_more(self) -> None:
        """Cancel an approver whose plan no longer waits."""
        if self._asking is not None:
            self._asking.cancel()

    def _abandon(self, mission: str) -> None:
        """Cancel or withdraw a mission, unless it is over."""
        if self._station.worked_on == mission:
            self._station.cancel()
        else:
            with suppress(ValueError):
                self._station.withdraw(mission)


def open_station(
    site: Site,
    *,
    approver: Approver,
    model: str | None = None,
    engine: Engine | None = None,
    fleet: Fleet | None = None,
    seed: int = 0,
    scenario: str | None = None,
    alarms: bool | None = None,
    rate: float | None = None,
    log: Path | str | None = None,
    on_event: OnEvent | None = None,
) -> Station:
    """Return a station on `site` for `async with`; it runs while that context lasts.

    `approver` is asked about every plan, even a plan that may only be rejected or modified. It must
    not block; if it needs time, it may return an awaitable instead of a Decision. Nothing moves
    before the approver has approved, and if the approver fails, the plan is rejected.

    `model` is the name of a catalogue model, the path of a GGUF file, or a model on a server,
    `openai:BASE_URL#NAME`. By default, it is the default model, which `pa-console models pull`
    fetches. A model on a server plans; the default model judges, and plans when the server does not
    answer. If `engine` is given, it is used instead of `model` and is not closed; several stations
    may share it.

    `fleet` is the fleet that the station drives, by default a simulation that begins with `seed`
    and plays `scenario`, given by name or path. If `alarms` is True, alarms become missions
    automatically; this is the default if a scenario is played. `rate` is the number of seconds on
    the fleet's clock per second of wall time. By default, it is 1 for devices, while a simulation
    runs as fast as it can and waits while a mission is being planned.

    `log` is the path of the signed session log, by default that of a new file beside the console's
    logs. While the log cannot be written, nothing is approved. `on_event` is called with every
    event after the event is logged. The signing key of this machine is made on first use.

    Raises ModelError if the model is missing, and ValueError for an unknown scenario. Entering the
    context raises LogError if the log cannot be opened; leaving it raises LogError if records were
    lost.
    """
    played = open_scenario(site.world, site.world_path, scenario) if scenario else None
    at_once = rate is None and (fleet is None or isinstance(fleet, Simulated))
    named = session_models(model, "", "")
    inner = assembly.open_station(
        site,
        engine if engine is not None else Engine(find_model(named.own, second_reader="")),
        SteppedClock() if at_once else RealTimeClock(rate or 1.0),
        seed=seed,
        keep_engine=engine is not None,
        scenario=played,
        respond=alarms if alarms is not None else played is not None,
        fleet=fleet,
        servers=Servers.open(named.named) if engine is None else NO_SERVERS,
    )
    open_log = partial(
        open_session_log,
        inner.session,
        load_signer(),
        path=Path(log) if log is not None else None,
        folder=default_folder(),
        on_error=_ignore_unwritable_log,
    )
    return Station(inner, open_log, approver, on_event)


def _outcome(trace: MissionTrace) -> Outcome:
    approved = trace.find(trace.executing) if trace.executing else None
    return Outcome(
        mission=trace.mission,
        status=trace.status or "failed",
        reason=trace.reason,
        plan=approved.plan if approved is not None else None,
        verification=trace.verification,
        report=trace.report,
        metrics=trace.metrics,
    )


def _settle(end: asyncio.Future[Outcome], result: Outcome | Exception) -> None:
    """Set the result of a waiting call, unless it has one already."""
    if end.done():
        return
    if isinstance(result, Exception):
        end.set_exception(result)
    else:
        end.set_result(result)


def _ignore_failed_request(_: Exception) -> None:
    """Ignore a failed request here: its client has received the error."""


def _ignore_unwritable_log(_: LogError) -> None:
    """Ignore an unwritable log here: the station reports it and approves nothing."""
