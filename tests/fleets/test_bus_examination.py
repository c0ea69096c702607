"""`doctor` reports what each robot on a message bus sends, and what is not as it should be."""

import json
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest

from pa_console.cli.verbs.doctor.checks import check_link
from pa_console.fleets.link import LinkFinding
from pa_console.fleets.newcomers import LinkSurvey, survey
from pa_console.fleets.vda5050.asset_state import state_of
from pa_console.fleets.vda5050.broker import BrokerAddress
from pa_console.fleets.vda5050.examination import BusListener
from pa_console.fleets.vda5050.gateway import factsheet_of
from pa_console.fleets.vda5050.messages import RobotConnection
from pa_console.fleets.vda5050.station_link import join
from pa_console.fleets.vda5050.vehicle import Vehicle
from pa_console.fleets.vda5050.wire import Identity, Numbers
from pa_console.schema.world import World
from pa_console.settings.schema import Settings
from pa_console.sim.checkpoint import Checkpoint
from tests.fleets.conftest import running
from tests.fleets.intruder import Intruder, intruder

ROBOT = "Robot_T01"
ME = Identity("acme", ROBOT)
POSITION, MODE = "mobileRobotPosition", "operatingMode"


def state(world: World, changes: Mapping[str, Any], ahead_s: float = 0.0) -> bytes:
    """Return the state of a robot that stands at its post, with `changes`."""
    report = Checkpoint(world).picture().assets[ROBOT]
    sent = datetime.now(UTC) + timedelta(seconds=ahead_s)
    vehicle = Vehicle(ME, frozenset(), lambda: sent)
    return json.dumps(json.loads(state_of(report, vehicle, 1, sent).write()) | changes).encode()


def say(robot: Intruder, topic: str, payload: bytes, *, retain: bool = False) -> None:
    robot.send(robot.topic(ROBOT, topic, ME.manufacturer), payload, retain=retain)


def connection(robot: Intruder, word: str = "ONLINE") -> None:
    """Send what a robot retains when its connection begins or ends."""
    header = Numbers().header(ME, "connection", datetime.now(UTC))
    message = RobotConnection.model_validate(header | {"connection_state": word})
    say(robot, "connection", message.write(), retain=True)


class Station:
    """A station that surveys the bus, and the rows of its table about the robot."""

    def __init__(self, world: World, address: BrokerAddress) -> None:
        self._listener = BusListener(world, join(address))

    def survey(self, seconds: float = 0.3) -> LinkSurvey:
        """Survey the bus, and leave it."""
        return survey(self._listener, seconds, examine=True)

    def rows(self) -> dict[str, LinkFinding]:
        """Return the findings of a survey about the robot."""
        return {row.what: row for row in self.survey().findings if row.agent == ROBOT}


def test_of_a_site_in_order_every_robot_and_camera_is_listed_and_nothing_is_wrong(
    world: World, address: BrokerAddress
) -> None:
    with running(world, address), intruder(address) as ear:
        check = check_link(str(address), Settings())
        assert (check.state, check.remedy) == ("ok", "")
        assert check.found.startswith(f"{address}: connected; reports from Drone_T01, ")
        assert {row.agent for row in check.details} == world.assets.keys() | world.cameras.keys()
        rows = {row.what: row.found for row in check.details if row.agent == ROBOT}
        assert rows.keys() == {
            "ready", "connection", "factsheet", "state", "place", "clock", "orders offered",
            "startPause",
        }  # fmt: skip
        assert rows["ready"] == "yes"
        assert rows["state"].endswith("a second")
        assert "warn" in rows["orders offered"]
        assert not [topic for topic, _ in ear.all if topic.endswith(("order", "instantActions"))]


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({MODE: "MANUAL"}, "a person drives it (MANUAL)"),
        ({MODE: "STARTUP"}, "its operating mode is STARTUP"),
        (
            {"safetyState": {"activeEmergencyStop": "REMOTE", "fieldViolation": False}},
            "its own stop is active (REMOTE)",
        ),
        ({"errors": [{"errorType": "laser", "errorLevel": "FATAL"}]}, "laser (FATAL)"),
        ({POSITION: None}, "it does not know where it is"),
    ],
)
def test_what_keeps_a_robot_from_starting_is_named(
    changes: dict[str, Any], why: str, world: World, address: BrokerAddress
) -> None:
    with intruder(address) as robot:
        connection(robot)
        station = Station(world, address)
        say(robot, "state", state(world, changes))
        row = station.rows()["ready"]
        assert (row.found, row.consequence) == (f"no: {why}", "it cannot start")


def test_what_is_not_as_it_should_be_has_its_consequence(
    world: World, address: BrokerAddress
) -> None:
    far = {POSITION: {"x": 4000.0, "y": 0.0, "theta": 0.0, "mapId": "site", "localized": True}}
    with intruder(address) as robot:
        connection(robot, "CONNECTION_BROKEN")
        header = Numbers().header(ME, "factsheet", datetime.now(UTC))
        sheet = json.loads(factsheet_of("robot", world, header).write())
        sheet["protocolFeatures"]["mobileRobotActions"] = []
        say(robot, "factsheet", json.dumps(sheet).encode(), retain=True)
        station = Station(world, address)
        say(robot, "state", b'{"version": "2.1.0"}')
        say(robot, "state", state(world, far, ahead_s=60.0))
        rows = station.rows()
        assert rows["ready"].found == "no: its connection is CONNECTION_BROKEN"
        assert rows["orders offered"].found == "none"
        assert rows["state, not valid"].consequence == "it is set aside"
        assert rows["clock"].found.startswith(("+60.", "+59."))
        assert all(rows[name].consequence for name in ("place", "clock", "startPause"))


def test_a_robot_that_is_only_remembered_by_the_broker_reports_nothing(
    world: World, address: BrokerAddress
) -> None:
    with intruder(address) as robot:
        say(robot, "state", state(world, {}), retain=True)
        connection(robot)
        seen = Station(world, address).survey()
        rows = {row.what: row for row in seen.findings}
        assert rows["state"].found == "never"
        assert rows["state, not valid"].found == "retained by the broker"
        assert ROBOT in seen.silent


def test_a_bus_without_a_broker_is_missing() -> None:
    assert check_link("mqtt://127.0.0.1:9/vda5050", Settings()).state == "missing"
