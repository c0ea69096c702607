"""Real ArduPilot, two copters and a rover, carries out every order; skipped where it is not."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from pa_console.fleets.linked_fleet import LinkedFleet
from pa_console.fleets.mavlink.link import open_link
from pa_console.mission.approval import standing_approver
from pa_console.schema.base import Point
from pa_console.schema.events import event as ev
from pa_console.schema.world import World
from pa_console.session.state import SessionState
from pa_console.settings.schema import Settings
from pa_console.sim.worlds.terrain import Terrain
from pa_console.station.assembly import load_site, open_station
from pa_console.station.clock import DevicesClock
from pa_console.station.headless import run_missions
from tests.fleets.mavlink import sitl
from tests.fleets.mavlink.drones import Driven, on_the_earth
from tests.fleets.mavlink.sitl import PARAMETERS, Frame, Radio, Sitl, moves_it, vehicles_yaml
from tests.scripted import ScriptedEngine, plan

pytestmark = [
    pytest.mark.ardupilot,
    pytest.mark.long,
    pytest.mark.skipif(bool(sitl.missing()), reason=sitl.missing()),
]
ONE, TWO, ROVER = "Drone_T01", "Drone_T02", "Ugv_T01"
SPEEDUP = 5.0
HEIGHTS = "altitude_m: 12\naltitudes_m: {observe: 15}"
LOITER, GUIDED = 5, 4


class Team(Driven):
    """Two copters and a rover at the base, on one link; the first copter's radio can be cut."""

    def __init__(self, folder: Path, world: World) -> None:
        places = Terrain.of(world).places(world.base, "uav")
        self.world, self.number = world, 0
        three: tuple[tuple[str, Frame, Point], ...] = (
            (ONE, "copter", places[3]),
            (TWO, "copter", places[4]),
            (ROVER, "rover", places[1]),
        )
        self.sitls = {
            name: Sitl(folder, frame, system, place, speedup=SPEEDUP)
            for system, (name, frame, place) in enumerate(three, 1)
        }
        self.radio = Radio(self.sitls[ONE].port)
        addresses = [self.radio.address, self.sitls[TWO].address, self.sitls[ROVER].address]
        file = folder / "vehicles.yaml"
        file.write_text(vehicles_yaml(world, addresses, [*self.sitls], HEIGHTS), encoding="utf-8")
        super().__init__(open_link(str(file), world, Settings()))

    def order(self, agent: str, verb: str, target: str | None = None) -> str:
        """Send a command; return its id."""
        self.number += 1
        name = f"c{self.number}"
        self.send(name, agent, verb, target)  # type: ignore[arg-type]
        return name

    def carry_out(self, agent: str, verb: str, target: str | None = None) -> str:
        """Send a command and wait for its end; return how it ended in words."""
        answer = self.end(self.order(agent, verb, target))
        return f"{answer.status}: {answer.detail}"

    def moving(self, agent: str, faster_than: float = 2.0) -> None:
        """Wait until a vehicle moves."""
        self.until(lambda: self.reports[agent].speed_mps > faster_than)

    def lands(self, agent: str) -> None:
        """Bring a vehicle home."""
        assert self.carry_out(agent, "return_to_base") == "done: at Base"

    def height(self, agent: str) -> float:
        """Return how high a vehicle is above its home."""
        fix = self.link._flights[agent].state.fix  # pyright: ignore[reportPrivateUsage]
        return fix.altitude_m if fix is not None else 0.0

    def close(self) -> None:
        """End everything."""
        self.link.close()
        self.radio.close()
        for each in self.sitls.values():
            each.kill()


@pytest.fixture(scope="module")
def team(world: World, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Team]:
    found = Team(tmp_path_factory.mktemp("ardupilot"), on_the_earth(world))
    try:
        found.until(lambda: found.fenced(3) and not any(found.not_ready.values()), 90.0)
        yield found
    finally:
        found.close()


def test_everything_that_is_needed_is_reported(team: Team) -> None:
    team.until(lambda: all(report.status == "ok" for report in team.reports.values()))
    assert {name: report.status for name, report in team.reports.items()} == dict.fromkeys(
        (ONE, TWO, ROVER), "ok"
    )
    assert all((report.battery_pct or 0.0) > 90.0 for report in team.reports.values())
    assert not team.told("does not send")


def test_why_it_did_not_arm_was_on_its_card_and_no_alarm(team: Team) -> None:
    said = [why for name, why in team.readiness if name == ONE]
    assert said[0] == "it has no position estimate yet"
    assert any("PreArm:" in why for why in said)
    assert said[-1] == ""
    assert not team.told("PreArm")


def test_it_arms_takes_off_goes_and_returns(team: Team) -> None:
    assert team.carry_out(ONE, "move_to", "EastGate") == "done: at EastGate"
    assert team.reports[ONE].task == "holding"
    assert team.height(ONE) == pytest.approx(12.0, abs=2.0)
    team.lands(ONE)
    assert team.reports[ONE].task == "charging"
    assert team.height(ONE) < 0.5


def test_a_hold_stops_it_in_flight_and_it_stays_up(team: Team) -> None:
    moved = team.order(TWO, "move_to", "SouthGate")
    team.moving(TWO)
    held = team.carry_out(TWO, "hold")
    assert held.startswith("done: holding at")
    assert team.end(moved).detail == "superseded"
    place, height = team.reports[TWO].position, team.height(TWO)
    stays_s = time.monotonic() + 4.0
    team.until(lambda: time.monotonic() > stays_s)
    assert team.reports[TWO].position == pytest.approx(place, abs=1.5)
    assert team.height(TWO) == pytest.approx(height, abs=1.5)
    assert team.carry_out(TWO, "move_to", "SouthGate") == "done: at SouthGate"
    team.lands(TWO)


def test_a_cut_of_twenty_seconds_ends_no_observation(team: Team) -> None:
    observed = team.order(ONE, "observe", "WestGate")
    team.until(lambda: team.height(ONE) > 5.0)
    team.radio.cut = True
    cut_until = time.monotonic() + 20.0 / SPEEDUP
    team.until(lambda: team.told("is no longer heard"))
    team.until(lambda: time.monotonic() > cut_until)
    team.radio.cut = False
    assert team.end(observed).detail == "at WestGate"
    assert team.told("is heard again")
    assert team.height(ONE) == pytest.approx(15.0, abs=2.0)
    team.lands(ONE)


def test_a_move_ends_with_the_autopilots_own_failsafe_when_the_link_is_cut(team: Team) -> None:
    moved = team.order(ONE, "move_to", "WestGate")
    team.until(lambda: team.height(ONE) > 10.5)
    team.radio.cut = True
    cut_until = time.monotonic() + 30.0 / SPEEDUP
    team.until(lambda: time.monotonic() > cut_until)
    team.radio.cut = False
    answer = team.end(moved)
    assert answer.status == "failed"
    assert "RTL" in answer.detail
    team.lands(ONE)


def test_a_place_outside_the_fence_is_refused_by_the_autopilot_itself(team: Team) -> None:
    other = team.sitls[TWO].other_station()
    try:
        assert team.carry_out(TWO, "move_to", "EastGate").startswith("done")
        assert other.fly_to((90.0, 0.0), 12.0) != 0
        assert team.carry_out(TWO, "move_to", "SouthGate") == "done: at SouthGate"
        team.lands(TWO)
    finally:
        other.close()


def test_a_pilot_who_takes_the_mode_keeps_it(team: Team) -> None:
    other = team.sitls[TWO].other_station()
    try:
        moved = team.order(TWO, "move_to", "WestGate")
        team.moving(TWO)
        other.take_over(LOITER)
        assert "a pilot has taken over (LOITER)" in team.end(moved).detail
        team.until(lambda: team.reports[TWO].manual)
        assert team.carry_out(TWO, "hold") == "refused: a pilot flies it (LOITER) and keeps it"
        assert team.carry_out(TWO, "move_to", "EastGate").startswith("refused: a pilot flies it")
        assert other.command(176, 1.0, GUIDED) == 0
        team.until(lambda: not team.reports[TWO].manual)
        assert team.carry_out(TWO, "move_to", "EastGate") == "done: at EastGate"
        team.lands(TWO)
    finally:
        other.close()


def test_a_rover_drives_holds_blocks_and_returns_without_taking_off(team: Team) -> None:
    moved = team.order(ROVER, "move_to", "Checkpoint")
    team.moving(ROVER, 1.0)
    assert team.carry_out(ROVER, "hold").startswith("done")
    assert team.end(moved).detail == "superseded"
    assert team.carry_out(ROVER, "block", "EastGate") == "done: at EastGate"
    assert team.reports[ROVER].task == "blocking"
    assert (
        team.carry_out(ROVER, "observe", "EastGate") == "refused: a ground vehicle cannot observe"
    )
    team.lands(ROVER)
    assert team.reports[ROVER].task == "charging"
    assert team.height(ROVER) == pytest.approx(0.0, abs=1.0)


def test_a_stop_of_the_team_in_motion_holds_all_three(team: Team) -> None:
    targets = {ONE: "NorthGate", TWO: "WestGate", ROVER: "Checkpoint"}
    moves = {name: team.order(name, "move_to", gate) for name, gate in targets.items()}
    team.until(lambda: all(team.reports[name].speed_mps > 1.0 for name in targets))
    stops = {name: team.order(name, "hold") for name in targets}
    assert {team.end(stop).status for stop in stops.values()} == {"done"}
    assert {team.end(move).status for move in moves.values()} == {"failed"}
    before = len(team.radio.commands)
    quiet_s = time.monotonic() + 3.0
    team.until(lambda: time.monotonic() > quiet_s)
    assert not any(moves_it(*command) for command in team.radio.commands[before:])
    for name in targets:
        team.lands(name)


def test_an_autopilots_low_battery_failsafe_ends_the_order_with_its_words(team: Team) -> None:
    other = team.sitls[TWO].other_station()
    try:
        moved = team.order(TWO, "move_to", "WestGate")
        team.moving(TWO)
        other.set_parameter("SIM_BATT_VOLTAGE", 9.6)
        answer = team.end(moved)
        assert answer.status == "failed"
        assert "RTL" in answer.detail
        assert "Battery" in answer.detail
        other.set_parameter("SIM_BATT_VOLTAGE", 12.6)
        team.lands(TWO)
    finally:
        other.close()


def test_a_fence_that_somebody_changes_refuses_orders_and_names_the_corner(team: Team) -> None:
    other = team.sitls[TWO].other_station()
    try:
        other.move_corner(1000)
        team.until(lambda: team.told("its geofence is not the world's: corner 1 of the perimeter"))
        refused = team.carry_out(TWO, "move_to", "EastGate")
        assert refused.startswith("refused: its geofence is not the world's: corner 1")
    finally:
        other.close()


def hurried(world: World) -> World:
    """Return the world with drones that may be as fast as a simulation that is sped up."""
    uav = world.platforms["uav"]
    faster = uav.model_copy(update={"speed_mps": uav.speed_mps * SPEEDUP})
    return world.model_copy(update={"platforms": {**world.platforms, "uav": faster}})


class Lone(Driven):
    """A copter at the base, with a link to it."""

    def __init__(self, folder: Path, world: World, *, parameters: Sequence[str]) -> None:
        at = world.frames[world.base].at
        self.sitl = Sitl(folder, "copter", 1, at, speedup=SPEEDUP, parameters=parameters)
        file = folder / "vehicles.yaml"
        file.write_text(vehicles_yaml(world, [self.sitl.address], [ONE], HEIGHTS), encoding="utf-8")
        super().__init__(open_link(str(file), world, Settings()))

    def ready(self) -> None:
        """Wait until it has its fence and can start."""
        self.until(lambda: self.fenced(1) and self.readiness[-1] == (ONE, ""), 90.0)

    def close(self) -> None:
        """End it."""
        self.link.close()
        self.sitl.kill()


def test_an_autopilot_that_is_killed_and_started_again_is_asked_for_everything_again(
    world: World, tmp_path: Path
) -> None:
    lone = Lone(tmp_path, on_the_earth(world), parameters=PARAMETERS)
    try:
        lone.ready()
        lone.send("c1", ONE, "move_to", "EastGate")
        lone.until(lambda: lone.reports[ONE].speed_mps > 2.0)
        lone.sitl.kill()
        lone.until(lambda: lone.told("is no longer heard"))
        lone.readiness.clear()
        lone.notices.clear()
        lone.sitl.start()
        lone.until(lambda: lone.told("has started again"))
        assert lone.end("c1").status == "failed"
        lone.until(lambda: lone.told("read back and is the world's"))
        lone.until(lambda: bool(lone.readiness) and lone.readiness[-1] == (ONE, ""))
        lone.send("c2", ONE, "move_to", "EastGate")
        assert lone.end("c2").detail == "at EastGate"
    finally:
        lone.close()


def test_a_battery_that_is_not_reported_counts_as_low_and_the_parameter_is_named(
    world: World, tmp_path: Path
) -> None:
    lone = Lone(tmp_path, on_the_earth(world), parameters=(*PARAMETERS, "BATT_MONITOR 0"))
    try:
        lone.ready()
        lone.until(lambda: lone.told("counts as low: set BATT_MONITOR"))
        fleet = LinkedFleet(on_the_earth(world), [lone.link])
        fleet.wait_for_reports(5.0)
        asset = fleet.picture().assets[ONE]
        assert (asset.charge, asset.low_battery, asset.available) == ("unknown", True, True)
        lone.send("c1", ONE, "move_to", "EastGate")
        assert lone.end("c1").detail == "at EastGate"
        assert sum("BATT_MONITOR" in notice.text for notice in lone.notices) == 1
    finally:
        lone.close()


async def test_a_mission_of_the_first_second_waits_until_the_drone_is_ready(
    world: World, tmp_path: Path
) -> None:
    there = hurried(on_the_earth(world))
    lone = Lone(tmp_path, there, parameters=PARAMETERS)
    said: list[str] = []
    try:
        site = replace(load_site("checkpoint", "checkpoint"), world=there)
        fleet = LinkedFleet(there, [lone.link])
        fleet.wait_for_reports(0.5)
        station = open_station(
            site,
            ScriptedEngine([plan((ONE, "move_to EastGate"))]).engine(),
            DevicesClock(1.0),
            fleet=fleet,
            read_unasked=False,
        )

        def sink(event: ev.Event, _state: SessionState) -> None:
            if isinstance(event.data, ev.Noticed) and event.mission is not None:
                said.append(event.data.text)

        fleet.close = lambda: None  # closed below
        approve = standing_approver("auto", "test")
        (trace,) = await run_missions(station, [f"Move {ONE} to the east gate."], approve, sink)
        assert trace.status == "verified", trace
        assert said[0].startswith(f"waits for {ONE} (not ready: it has no position estimate yet")
        assert said[1] == "goes on"
    finally:
        lone.close()


def test_doctor_names_parameters_that_are_not_as_they_should_be(
    world: World, tmp_path: Path
) -> None:
    lone = Lone(tmp_path, on_the_earth(world), parameters=())
    try:
        lone.ready()
        found = {each.what: each for each in lone.link.examine(10.0)}
    finally:
        lone.close()
    assert found["ready"].found == "yes"
    assert found["GLOBAL_POSITION_INT"].found.endswith("a second")
    wrong = {what: each.wanted for what, each in found.items() if each.consequence}
    assert wrong == {
        "BATT_FS_LOW_ACT": "2",
        "FS_GCS_ENABLE": "1",
        "MAV_GCS_SYSID": "245",
        "FS_OPTIONS": "a value that includes 2",
    }
    assert found["BATT_MONITOR"].found == "4"
