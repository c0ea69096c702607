"""Two copters and a rover of ArduPilot and robots on a message bus are one team and session."""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from pa_console.cli.sessions.fleet import find_fleet
from pa_console.fleets.linked_fleet import LinkedFleet
from pa_console.fleets.vda5050.broker import BrokerAddress
from pa_console.mission.approval import standing_approver
from pa_console.mission.gate import CommandGate
from pa_console.mission.stop import EmergencyStop
from pa_console.schema.command import DeviceCommand
from pa_console.schema.world import World
from pa_console.session.log.journal import Journal
from pa_console.settings.schema import Settings
from pa_console.sim.worlds.terrain import Terrain
from pa_console.sim.worlds.world_generator import world_yaml
from pa_console.station.assembly import Site, load_site, open_station
from pa_console.station.clock import DevicesClock
from pa_console.station.headless import run_missions
from tests.fleets.mavlink import sitl
from tests.fleets.mavlink.drones import on_the_earth
from tests.fleets.mavlink.sitl import Sitl, vehicles_yaml
from tests.fleets.mavlink.test_ardupilot import HEIGHTS, ONE, ROVER, SPEEDUP, TWO
from tests.fleets.test_example_robot import PAGE, program
from tests.scripted import ScriptedEngine, plan

pytestmark = [
    pytest.mark.ardupilot,
    pytest.mark.long,
    pytest.mark.skipif(bool(sitl.missing()), reason=sitl.missing()),
]
ON_BUS = ("Robot_T01", "Robot_T02")
TEAM = (ONE, TWO, ROVER, *ON_BUS)
TARGETS = dict(
    zip(TEAM, ("NorthGate", "WestGate", "EastGate", "WestGate", "NorthGate"), strict=True)
)
MISSIONS = (
    (f"Move {ONE} to the east gate.", plan((ONE, "move_to EastGate"))),
    (f"Move {ROVER} to the checkpoint.", plan((ROVER, "move_to Checkpoint"))),
    (f"Move {ON_BUS[0]} to the east gate.", plan((ON_BUS[0], "move_to EastGate"))),
)
LIMIT_S = 240.0


@dataclass
class MixedTeam:
    """The fleet of five vehicles, opened with two `--fleet`, and its site."""

    site: Site
    fleet: LinkedFleet
    autopilots: list[Sitl]

    def __post_init__(self) -> None:
        self.stops = EmergencyStop(self.fleet, CommandGate(self.fleet, Journal()))

    def until(self, done: Callable[[], bool]) -> None:
        """Step the fleet in real time until `done`; raises TimeoutError if that takes too long."""
        end_s = time.monotonic() + LIMIT_S
        while not done():
            if time.monotonic() > end_s:
                raise TimeoutError(str(self.fleet.picture().assets))
            self.stops.step((self.fleet.tick, self.fleet.step().replies))
            time.sleep(self.fleet.world.dt_s)

    def speeds(self) -> list[float]:
        """Return the speed of each vehicle, as its own reports have it."""
        assets = self.fleet.picture().assets
        return [assets[name].speed_mps for name in TEAM]


@pytest.fixture
def team(world: World, address: BrokerAddress, tmp_path: Path) -> Iterator[MixedTeam]:
    there = on_the_earth(world)
    world_file, vehicles_file = tmp_path / "world.yaml", tmp_path / "vehicles.yaml"
    world_file.write_text(world_yaml(there), encoding="utf-8")
    (tmp_path / "robot.py").write_text(program(), encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(PAGE.parents[2])}
    words = [sys.executable, "robot.py", address.host, str(address.port), address.site]
    robots = [subprocess.Popen([*words, name], cwd=tmp_path, env=environment) for name in ON_BUS]
    places = Terrain.of(there).places(there.base, "uav")
    autopilots = [
        Sitl(tmp_path, "copter", 1, places[3], speedup=SPEEDUP),
        Sitl(tmp_path, "copter", 2, places[4], speedup=SPEEDUP),
        Sitl(tmp_path, "rover", 3, places[1], speedup=SPEEDUP),
    ]
    addresses = [autopilot.address for autopilot in autopilots]
    text = vehicles_yaml(there, addresses, (ONE, TWO, ROVER), HEIGHTS)
    vehicles_file.write_text(text, encoding="utf-8")
    try:
        urls = [str(address), f"mavlink:{vehicles_file}"]
        found = find_fleet(urls, None, str(world_file), Settings(), None)
        site = load_site(found.world, "checkpoint")
        fleet, bus = found.drive(site, None)
        assert isinstance(fleet, LinkedFleet)
        assert bus is not None
        yield MixedTeam(site, fleet, autopilots)
        fleet.close()
    finally:
        for process in (*autopilots, *robots):
            process.kill()


async def test_each_carries_out_its_missions_and_one_stop_holds_all_five(team: MixedTeam) -> None:
    fleet = team.fleet
    close, fleet.close = fleet.close, lambda: None
    team.until(lambda: all(fleet.picture().assets[name].available for name in TEAM))
    for autopilot in team.autopilots:
        station = autopilot.other_station()
        station.set_parameter("SIM_SPEEDUP", 1.0)
        station.close()
    links = {name: fleet.picture().links[name].partition(":")[0] for name in TEAM}
    assert links == dict.fromkeys((ONE, TWO, ROVER), "mavlink") | dict.fromkeys(ON_BUS, "mqtt")
    engine = ScriptedEngine([answer for _, answer in MISSIONS]).engine()
    station = open_station(team.site, engine, DevicesClock(1.0), fleet=fleet, read_unasked=False)
    approve = standing_approver("auto", "test")
    texts = [text for text, _ in MISSIONS]
    traces = await run_missions(station, texts, approve, lambda _event, _state: None)
    assert [trace.status for trace in traces] == ["verified"] * len(MISSIONS)
    for number, (name, target) in enumerate(TARGETS.items()):
        order = DeviceCommand(command_id=f"S.{number}", agent=name, verb="move_to", target=target)
        fleet.send(order)
    travelled = set[str]()

    def all_travelled() -> bool:
        speeds = zip(TEAM, team.speeds(), strict=True)
        travelled.update(name for name, speed in speeds if speed > 0.5)
        return travelled == set(TEAM)

    team.until(all_travelled)
    team.stops.hold_all()
    team.until(lambda: max(team.speeds()) < 0.3)
    fleet.close = close
