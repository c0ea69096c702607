"""Missions without a screen: a station that runs one mission after another, with an approver."""

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from contextlib import aclosing

from pa_console.schema.events import event as ev
from pa_console.schema.incident import Incident
from pa_console.schema.mission import Decision, MissionStatus
from pa_console.session.state import MissionTrace, SessionState
from pa_console.station.station import ControlStation

Approver = Callable[[ev.ApprovalRequested], Decision | Awaitable[Decision]]
"""A function that decides on one plan at a time, as an operator does (paper, Step 6).

The session continues while the function decides.
"""
Sink = Callable[[ev.Event, SessionState], None]
SETUP_SETTLE_S = 2.0
EXIT_CODES: dict[MissionStatus, int] = {
    "verified": 0,
    "unverified": 4,
    "refused": 3,
    "rejected": 3,
    "held": 3,
    "cancelled": 3,
    "failed": 1,
}


async def run_missions(  # noqa: PLR0917
    station: ControlStation,
    texts: Sequence[str],
    approver: Approver,
    sink: Sink,
    setup: Sequence[Incident] = (),
    duration_s: float = 0.0,
    *,
    read_ahead: bool = False,
    decided: Callable[[], bool] = lambda: False,
) -> list[MissionTrace]:
    """Apply the set-up, run `texts` in order, and return the trace of every mission.

    A text that is a question about the record is answered without a mission. The session lasts
    until all missions are over, including those from alarms, and at least `duration_s` simulated
    seconds. It ends earlier if all missions are over and `decided` returns True. `sink` receives
    every event and the state after it, in order. After a stop, the remaining `texts` are not
    submitted, even if the stop is released. With `read_ahead`, the model reads the picture and all
    but the last word of a mission before the mission is submitted, as it does while an operator
    types. Raises ValueError if the station does not accept the set-up or a mission.
    """
    state = SessionState()
    waiting, all_given = list(texts), asyncio.Event()
    mine: str | None = None
    ending: asyncio.Task[None] | None = None
    answers = _Answers(station, approver)
    begun = False

    async def submit() -> str | None:
        """Submit the next mission, and return its id; None if no mission is left."""
        while waiting and (question := station.question_in(waiting[0])) is not None:
            waiting.pop(0)
            await station.answer(question)
        if waiting and read_ahead:
            await station.read_ahead(waiting[0])
        if station.stopped:
            waiting.clear()
        given = station.submit(waiting.pop(0)).id if waiting else None
        if not waiting:
            all_given.set()
        return given

    try:
        async with aclosing(station.run()) as events:
            async for event in events:
                state.apply(event)
                sink(event, state)
                match event.data:
                    case ev.TelemetryReceived() if not begun:
                        begun = True
                        if setup:
                            for incident in setup:
                                station.inject(incident)
                            await station.advance(SETUP_SETTLE_S)
                        mine = await submit()
                        ending = asyncio.create_task(_end(station, duration_s, all_given, decided))
                    case ev.ApprovalRequested():
                        await answers.decide(event.data)
                    case ev.DecisionMade(accepted=False, detail=problem):
                        await answers.decide_again(problem)
                    case ev.AllStopped():
                        waiting.clear()
                        all_given.set()
                    case ev.MissionFinished() if event.mission == mine and waiting:
                        mine = await submit()
                    case _:
                        pass
    finally:
        if ending is not None:
            ending.cancel()
            await asyncio.gather(ending, return_exceptions=True)
    return list(state.missions.values())


class _Answers:
    """The approver's decisions on the plans that wait."""

    def __init__(self, station: ControlStation, approver: Approver) -> None:
        self._station, self._approver = station, approver
        self._request: ev.ApprovalRequested | None = None
        self._given: Decision | None = None

    async def decide(self, request: ev.ApprovalRequested) -> None:
        """Pass the approver's decision on `request` to the station, if a plan still waits."""
        self._request = request
        if self._station.awaits_decision:
            self._give(await self._decision(request))

    async def decide_again(self, problem: str) -> None:
        """Decide again, because the last decision was not accepted.

        If the approver repeats the decision, the plan is rejected, because the station would refuse
        the same decision again and again.
        """
        if self._request is None or not self._station.awaits_decision:
            return
        decision = await self._decision(self._request)
        if decision == self._given:
            decision = Decision(
                kind="reject", request_id=decision.request_id, by=decision.by, reason=problem
            )
        self._give(decision)

    async def _decision(self, request: ev.ApprovalRequested) -> Decision:
        answer = self._approver(request)
        decision = answer if isinstance(answer, Decision) else await answer
        return decision.model_copy(update={"request_id": request.request_id})

    def _give(self, decision: Decision) -> None:
        """Pass a decision to the station, unless the plan has stopped waiting meanwhile."""
        if self._station.awaits_decision:
            self._given = decision
            self._station.decide(decision)


async def _end(
    station: ControlStation,
    duration_s: float,
    all_given: asyncio.Event,
    decided: Callable[[], bool],
) -> None:
    """Close the session after the last mission, and not before `duration_s` has passed.

    If `decided` returns True, it is closed directly after the last mission.
    """
    if duration_s > 0.0:
        over = asyncio.create_task(_missions_over(station, all_given))
        try:
            await _watched(station, duration_s, over, decided)
        finally:
            over.cancel()
    await _missions_over(station, all_given)  # alarms may have started more missions
    await station.close("every mission is finished")


async def _missions_over(station: ControlStation, all_given: asyncio.Event) -> None:
    await all_given.wait()
    await station.settled()


async def _watched(
    station: ControlStation,
    duration_s: float,
    over: asyncio.Task[None],
    decided: Callable[[], bool],
) -> None:
    """Wait until `duration_s` has passed, or `over` is done and `decided` returns True."""
    watching = asyncio.create_task(station.advance(duration_s))
    try:
        await asyncio.wait((over, watching), return_when=asyncio.FIRST_COMPLETED)
        if not (over.done() and decided()):
            await watching
    finally:
        watching.cancel()


def exit_code(statuses: Sequence[MissionStatus | None]) -> int:
    """Return the exit code of the worst of the missions' final statuses; 0 without missions.

    An internal failure is worse than an unverified plan, which is worse than an unexecuted one.
    """
    codes = [EXIT_CODES[status] if status is not None else 1 for status in statuses]
    return next((code for code in (1, 4, 3) if code in codes), 0)
