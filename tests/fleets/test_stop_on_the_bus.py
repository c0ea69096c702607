"""STOP on a bus: every reachable vehicle stands, whatever was sent to it before."""

import json

import pytest

from pa_console.fleets.vda5050.broker import BrokerAddress
from pa_console.fleets.vda5050.mqtt_fleet import MqttFleet
from pa_console.mission.gate import CommandGate
from pa_console.mission.stop import EmergencyStop
from pa_console.schema.command import DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.world import World
from pa_console.session.log.journal import Journal
from tests.fleets.conftest import joined, running
from tests.fleets.intruder import intruder

DRONE = "Drone_T04"


class Session:
    """The part of a station that orders and stops, stepped by the test."""

    def __init__(self, fleet: MqttFleet) -> None:
        self.fleet = fleet
        self.stops = EmergencyStop(fleet, CommandGate(fleet, Journal()))
        self.events: list[ev.EventPayload] = []

    def go(self, steps: int) -> None:
        """Let time pass; follow the stops."""
        for _ in range(steps):
            replies = self.fleet.step().replies
            self.events += self.stops.step((self.fleet.tick, replies))

    def stop(self) -> None:
        """Press STOP."""
        self.events += self.stops.hold_all()

    @property
    def position(self) -> tuple[float, float]:
        """Where the drone is in the picture."""
        return self.fleet.picture().assets[DRONE].position


@pytest.mark.parametrize("earlier_stops", [1, 2])
def test_a_later_session_stops_a_vehicle_that_an_earlier_one_has_stopped(
    earlier_stops: int, world: World, address: BrokerAddress
) -> None:
    with running(world, address, paced=True) as site:
        with joined(world, address) as fleet:
            first = Session(fleet)
            for _ in range(earlier_stops):
                first.stop()
                first.go(20)
        with joined(world, address) as fleet:
            second = Session(fleet)
            second.go(10)
            order = DeviceCommand(
                command_id="M001.1.1", agent=DRONE, verb="move_to", target="WestGate"
            )
            fleet.send(order)
            second.go(20)
            second.stop()
            second.go(10)
            stood = site.site.checkpoint.truth().assets[DRONE]
            assert stood.speed_mps == 0.0
            second.go(50)
            assert site.site.checkpoint.truth().assets[DRONE].position == stood.position


def test_a_stop_whose_id_somebody_has_used_up_beforehand_stops_all_the_same(
    world: World, address: BrokerAddress
) -> None:
    with (
        intruder(address) as evil,
        running(world, address, paced=True) as site,
        joined(world, address) as fleet,
    ):
        session = Session(fleet)
        session.go(10)
        header = json.loads(evil.heard[evil.topic(DRONE, "state")])
        for name in ("stop1.4", "stop1.4.cancel"):
            action = {"actionId": name, "actionType": "stateRequest", "blockingType": "NONE"}
            evil.send(
                evil.topic(DRONE, "instantActions"),
                json.dumps({**header, "actions": [action]}).encode(),
            )
        fleet.send(
            DeviceCommand(command_id="M001.1.1", agent=DRONE, verb="move_to", target="WestGate")
        )
        session.go(20)
        session.stop()
        session.go(20)
        assert site.site.checkpoint.truth().assets[DRONE].speed_mps == 0.0
        assert not session.stops.waiting
        assert not [e for e in session.events if isinstance(e, ev.StopUnconfirmed)]


def test_no_two_connections_use_one_action_id(world: World, address: BrokerAddress) -> None:
    ids: list[str] = []
    with intruder(address) as ear, running(world, address, paced=True):
        for _ in range(2):
            with joined(world, address) as fleet:
                session = Session(fleet)
                session.stop()
                session.go(5)
        for topic, payload in ear.all:
            if topic.endswith("/instantActions"):
                ids += [action["actionId"] for action in json.loads(payload)["actions"]]
    assert len(ids) > 2 * len(world.assets)
    assert len(set(ids)) == len(ids)
