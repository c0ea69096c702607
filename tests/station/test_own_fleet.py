"""A station drives a fleet of somebody's own, in which nothing is simulated."""

from collections.abc import Sequence

import pytest

from pa_console.fleets.fleet import Received
from pa_console.mission.approval import standing_approver
from pa_console.schema.command import CommandReply, DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.incident import FailAsset, Scenario
from pa_console.schema.telemetry import AssetTelemetry, GateCover, Picture
from pa_console.schema.world import World
from pa_console.session.state import SessionState
from pa_console.sim.worlds.scenario_file import LoadedScenario
from pa_console.station.assembly import Site, open_station
from pa_console.station.clock import SteppedClock
from pa_console.station.headless import run_missions
from pa_console.station.station import ControlStation
from tests.scripted import ScriptedEngine, plan

TELLS = ev.Noticed(level="info", subject="Drone_T04", text="its operator has said hello")


class TeleportingFleet:
    """Assets that are at once where they are sent."""

    def __init__(self, world: World, at: dict[str, str] | None = None, tick: int = 0) -> None:
        self.world, self.tick, self.closed = world, tick, False
        self.at = at or {name: spec.post for name, spec in world.assets.items()}
        self.sent: list[DeviceCommand] = []
        self._told = [TELLS]
        self.manual: frozenset[str] = frozenset()

    @property
    def time_s(self) -> float:
        """Return the seconds of all steps so far."""
        return self.tick * self.world.dt_s

    def picture(self) -> Picture:
        """Report where everybody is."""
        gates = {gate: [n for n, at in self.at.items() if at == gate] for gate in self.world.gates}
        return Picture(
            tick=self.tick,
            time_s=self.time_s,
            assets={name: self._report(name, at) for name, at in self.at.items()},
            gates={g: GateCover(covered=bool(by), by=tuple(by)) for g, by in gates.items()},
        )

    def _report(self, name: str, at: str) -> AssetTelemetry:
        return AssetTelemetry(
            id=name, kind=self.world.assets[name].kind, at=at, post=at, stamp_s=self.time_s,
            position=self.world.frames[at].at, heading_deg=0.0, speed_mps=0.0, status="ok",
            task="idle", battery_pct=90.0, low_battery=False, comms="ok",
            available=name not in self.manual, manual=name in self.manual,
        )  # fmt: skip

    def mark_manual(self, assets: frozenset[str]) -> None:
        """Report `assets` as under manual control."""
        self.manual = assets

    def send(self, command: DeviceCommand) -> None:
        """Obey with the next step."""
        self.sent.append(command)

    def step(self) -> Received:
        """Do what was sent, and answer."""
        self.tick += 1
        replies = [reply for command in self.sent for reply in self._obey(command)]
        self.sent.clear()
        told, self._told = self._told, []
        return Received(tuple(replies), tuple(told))

    def _obey(self, command: DeviceCommand) -> list[CommandReply]:
        if command.target is not None:
            self.at[command.agent] = command.target
        said = {"command_id": command.command_id, "agent": command.agent, "tick": self.tick}
        return [CommandReply(status=word, **said) for word in ("acknowledged", "done")]  # pyright: ignore[reportArgumentType]

    def forecast(self) -> "TeleportingForecast":
        """Return the same assets, of which no device hears."""
        return TeleportingForecast(TeleportingFleet(self.world, dict(self.at), self.tick))

    def close(self) -> None:
        """Note that the session is over."""
        self.closed = True


class TeleportingForecast:
    """The same, where nobody is told of anything else than replies."""

    def __init__(self, twin: TeleportingFleet) -> None:
        self._twin, self.world = twin, twin.world
        self.picture, self.send = twin.picture, twin.send

    @property
    def time_s(self) -> float:
        """Return the seconds of all steps so far."""
        return self._twin.time_s

    def step(self) -> Sequence[CommandReply]:
        """Do what was sent; return the answers."""
        return self._twin.step().replies


def station_of(site: Site, fleet: TeleportingFleet) -> ControlStation:
    engine = ScriptedEngine([plan(("Drone_T04", "move_to WestGate"))])
    return open_station(site, engine.engine(), SteppedClock(), fleet=fleet)


async def test_a_mission_on_a_fleet_of_ones_own_is_verified_by_its_telemetry(site: Site) -> None:
    fleet = TeleportingFleet(site.world)
    told: list[ev.EventPayload] = []

    def sink(event: ev.Event, _: SessionState) -> None:
        told.append(event.data)

    station = station_of(site, fleet)
    traces = await run_missions(
        station, ["Send Drone_T04 to the West Gate."], standing_approver("auto"), sink
    )
    assert [trace.status for trace in traces] == ["verified"], traces[0].reason
    assert fleet.at["Drone_T04"] == "WestGate"
    assert TELLS in told
    assert fleet.closed


async def test_only_in_a_simulated_fleet_does_anything_happen_on_demand(site: Site) -> None:
    station = station_of(site, TeleportingFleet(site.world))
    with pytest.raises(ValueError, match="simulated fleet"):
        station.inject(FailAsset(asset="Drone_T01"))
    scenario = Scenario(name="s", title="s", about="s", duration_s=10.0)
    with pytest.raises(ValueError, match="scenario s is for a simulated fleet only"):
        open_station(
            site,
            ScriptedEngine([]).engine(),
            SteppedClock(),
            scenario=LoadedScenario(scenario, "0" * 64),
            fleet=TeleportingFleet(site.world),
        )
