"""A station on the real checkpoint with a scripted LLM, and a way to run it."""

from collections.abc import Callable, Sequence

import pytest

from pa_console.orchestrator.clock import SteppedClock
from pa_console.orchestrator.compose import Site, load_site, open_station
from pa_console.orchestrator.headless import Approver, run_missions, standing_approver
from pa_console.orchestrator.station import Station
from pa_console.schema.event import Event
from pa_console.schema.incident import Incident
from pa_console.session.fold import MissionTrace, SessionState
from tests.scripted import ScriptedEngine

MISSION = "Watch the checkpoint and say what you see."


class Rig:
    """Runs missions and keeps every event of them."""

    def __init__(self, site: Site) -> None:
        self.site = site
        self.events: list[Event] = []
        self.state = SessionState()

    def station(self, engine: ScriptedEngine) -> Station:
        """Return a fresh station on the checkpoint."""
        return open_station(self.site, engine.engine(), SteppedClock())

    async def run(
        self,
        engine: ScriptedEngine,
        setup: Sequence[Incident] = (),
        approver: Approver | None = None,
        text: str = MISSION,
        on_event: Callable[[Event, Station], None] = lambda _event, _station: None,
    ) -> MissionTrace:
        """Run one mission to its end; `on_event` may act on the station."""
        station = self.station(engine)

        def sink(event: Event, state: SessionState) -> None:
            self.events.append(event)
            self.state = state
            on_event(event, station)

        decide = approver or standing_approver("auto")
        return (await run_missions(station, [text], decide, sink, setup))[0]

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
