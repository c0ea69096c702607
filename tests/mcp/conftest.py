"""A session with a scripted model, and agents beside it."""

import asyncio
from collections.abc import AsyncGenerator, Callable
from contextlib import aclosing, asynccontextmanager
from datetime import UTC, datetime

from pa_console.mcp.agents_session import AgentsSession
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Decision, Mission
from pa_console.session.mission_trace import MissionTrace
from pa_console.session.state import SessionState
from pa_console.station.assembly import Site, open_station
from pa_console.station.clock import RealTimeClock
from pa_console.station.station import ControlStation
from tests.rig import site
from tests.scripted import ScriptedEngine, plan

__all__ = ["site"]

FILL = plan(("Drone_T04", "move_to EastGate"))
UNKNOWN = MissionTrace(Mission(id="?", text="?", created=datetime.now(UTC)))
PATIENCE_S = 60.0
"""How long a test waits for what must come."""


class Beside:
    """A running session: its events, its state, its station, and its agents."""

    def __init__(self, station: ControlStation) -> None:
        self.station, self.agents = station, AgentsSession(station)
        self.take: Callable[[ev.Event], None] = self.agents.take
        self.events: list[ev.Event] = []
        self._moved = asyncio.Event()

    @property
    def state(self) -> SessionState:
        """The session as it stands."""
        return self.agents.state

    async def follow(self) -> None:
        """Take in every event until the session ends."""
        async with aclosing(self.station.run()) as events:
            async for event in events:
                self.events.append(event)
                self.take(event)
                self._moved.set()

    async def until(self, true: Callable[[], object]) -> None:
        """Wait until something is true of the session."""
        async with asyncio.timeout(PATIENCE_S):
            while not true():
                self._moved.clear()
                await self._moved.wait()

    async def waiting(self, mission_id: str) -> ev.ApprovalRequested:
        """Return the plan of a mission as soon as it waits for a decision."""
        await self.until(lambda: self._trace(mission_id).approval)
        request = self._trace(mission_id).approval
        assert request is not None
        return request

    async def ended(self, mission_id: str) -> str:
        """Return how a mission ended, as soon as it has."""
        await self.until(lambda: self._trace(mission_id).status)
        return str(self._trace(mission_id).status)

    def _trace(self, mission_id: str) -> MissionTrace:
        """Return a mission's trace; an empty one until the session has told of it."""
        return self.state.missions.get(mission_id) or UNKNOWN

    def approve(self, request: ev.ApprovalRequested, by: str = "operator") -> None:
        """Approve a plan as a person."""
        decision = Decision(
            kind="approve",
            request_id=request.request_id,
            by=by,
            override_judge=request.needs_override,
            reason="seen",
            acknowledged=request.acknowledge,
        )
        self.station.decide(decision)

    @property
    def decided(self) -> list[ev.DecisionMade]:
        """The decisions, taken or not."""
        return [e.data for e in self.events if isinstance(e.data, ev.DecisionMade)]

    @property
    def sent(self) -> list[ev.CommandSent]:
        """The commands that left the station."""
        return [e.data for e in self.events if isinstance(e.data, ev.CommandSent)]


@asynccontextmanager
async def beside(
    site: Site,
    engine: ScriptedEngine | None = None,
    admit: Callable[[AgentsSession], Callable[[ev.Event], None]] | None = None,
    *,
    respond: bool = False,
) -> AsyncGenerator[Beside]:
    """Run a session at eight times real time while the context lasts.

    `admit` returns what takes its events in place of its agents. With `respond`, alarms start
    missions.
    """
    model = engine or ScriptedEngine([FILL])
    running = Beside(open_station(site, model.engine(), RealTimeClock(8.0), respond=respond))
    if admit is not None:
        running.take = admit(running.agents)
    following = asyncio.create_task(running.follow())
    await running.until(lambda: running.state.picture is not None)
    try:
        yield running
    finally:
        await running.station.close("the test is over")
        await following
