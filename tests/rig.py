"""A station on the real checkpoint with a scripted LLM, and a way to run it."""

from collections.abc import Callable, Sequence

import pytest

from pa_console.mission.approval import Approver, standing_approver
from pa_console.schema.evaluation import Variant
from pa_console.schema.events.event import Event
from pa_console.schema.incident import Incident, Scenario
from pa_console.session.state import MissionTrace, SessionState
from pa_console.sim.worlds.scenario_file import LoadedScenario
from pa_console.station.assembly import Site, load_site, open_station
from pa_console.station.clock import SteppedClock
from pa_console.station.headless import run_missions
from pa_console.station.station import ControlStation
from tests.scripted import ScriptedEngine

MISSION = "Watch the checkpoint and say what you see."


class Rig:
    """Runs missions and keeps every event of them."""

    def __init__(self, site: Site) -> None:
        self.site = site
        self.variant = Variant()
        self.events: list[Event] = []
        self.state = SessionState()

    def station(
        self, engine: ScriptedEngine, scenario: Scenario | None = None, respond: bool = False
    ) -> ControlStation:
        """Return a fresh station on the checkpoint; with `respond`, alarms start missions."""
        played = LoadedScenario(scenario, "0" * 64) if scenario is not None else None
        return open_station(
            self.site,
            engine.engine(),
            SteppedClock(),
            scenario=played,
            respond=respond,
            variant=self.variant,
        )

    async def carry_out(
        self,
        station: ControlStation,
        texts: Sequence[str],
        approver: Approver | None = None,
        on_event: Callable[[Event, ControlStation], None] = lambda _event, _station: None,
        *,
        setup: Sequence[Incident] = (),
        duration_s: float = 0.0,
    ) -> list[MissionTrace]:
        """Run missions at `station` to their end; `on_event` may act on the station."""

        def sink(event: Event, state: SessionState) -> None:
            self.events.append(event)
            self.state = state
            on_event(event, station)

        decide = approver or standing_approver("auto")
        return await run_missions(station, texts, decide, sink, setup, duration_s)

    async def play(
        self,
        engine: ScriptedEngine,
        scenario: Scenario,
        approver: Approver | None = None,
        on_event: Callable[[Event, ControlStation], None] = lambda _event, _station: None,
    ) -> SessionState:
        """Play `scenario` to its end with alarms that start missions; return the state."""
        station = self.station(engine, scenario, respond=True)
        await self.carry_out(station, [], approver, on_event, duration_s=scenario.duration_s)
        return self.state

    async def run(
        self,
        engine: ScriptedEngine,
        setup: Sequence[Incident] = (),
        approver: Approver | None = None,
        text: str = MISSION,
        on_event: Callable[[Event, ControlStation], None] = lambda _event, _station: None,
    ) -> MissionTrace:
        """Run one mission to its end."""
        station = self.station(engine)
        return (await self.carry_out(station, [text], approver, on_event, setup=setup))[0]

    def kinds(self) -> list[str]:
        """Return the kinds of all events, in order."""
        return [event.data.kind for event in self.events]


@pytest.fixture(scope="session")
def site() -> Site:
    """Return the checkpoint with its rules."""
    return load_site("checkpoint", "checkpoint")


@pytest.fixture
def rig(site: Site) -> Rig:
    """Return a rig of its own for each test."""
    return Rig(site)
