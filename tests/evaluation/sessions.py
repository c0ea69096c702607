"""Sessions with a scripted LLM, played without a screen for tests of what can be done with them."""

from collections.abc import Callable
from pathlib import Path

from pa_console.mission.approval import standing_approver
from pa_console.schema.events.event import Event
from pa_console.schema.incident import Incident, Scenario, ScriptedEvent
from pa_console.session.log.writer import LogWriter
from pa_console.session.state import SessionState
from pa_console.sim.worlds.scenario_file import LoadedScenario
from pa_console.station.assembly import Site, open_station
from pa_console.station.clock import SteppedClock
from pa_console.station.headless import run_missions
from pa_console.station.station import ControlStation
from tests.scripted import ScriptedEngine, plan

RECON = plan(("Drone_T04", "observe WestGate"))
IDENTIFY = plan(("Robot_T01", "identify WestGate"))
WARN = plan(("Robot_T01", "warn WestGate"))


def scenario(*events: tuple[float, Incident], duration_s: float = 60.0) -> Scenario:
    """Return a scenario of incidents at times."""
    return Scenario(
        name="test",
        title="test",
        about="test",
        duration_s=duration_s,
        events=tuple(ScriptedEvent(at_s=at_s, do=do) for at_s, do in events),
    )


async def play(
    site: Site,
    engine: ScriptedEngine,
    played: Scenario,
    *,
    seed: int = 0,
    log: Path | None = None,
    on_event: Callable[[Event, ControlStation], None] = lambda _event, _station: None,
) -> list[Event]:
    """Play `played` to its end; return its events and write them to `log`, if one is given."""
    station = open_station(
        site,
        engine.engine(),
        SteppedClock(),
        seed=seed,
        scenario=LoadedScenario(played, "0" * 64),
        respond=True,
    )
    events: list[Event] = []

    def sink(event: Event, _: SessionState) -> None:
        events.append(event)
        on_event(event, station)

    approver = standing_approver("auto")
    await run_missions(station, [], approver, sink, duration_s=played.duration_s)
    if log is not None:
        with LogWriter(log, station.session) as writer:
            for event in events:
                writer.append(event)
    return events
