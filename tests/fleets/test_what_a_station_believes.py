"""What comes from the bus and is wrong is told, and changes nothing that the station believes."""

import json
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from random import Random
from typing import Any

import pytest

from pa_console.fleets.fleet import Simulated
from pa_console.fleets.reported_picture import ReportedPicture
from pa_console.fleets.reports import ContactReport, SensorReport
from pa_console.fleets.simulated import SimulatedFleet
from pa_console.fleets.vda5050.broker import BrokerAddress
from pa_console.fleets.vda5050.mqtt_fleet import MqttFleet
from pa_console.fleets.vda5050.wire import MOST_BYTES
from pa_console.schema.command import DeviceCommand
from pa_console.schema.events.event import Noticed
from pa_console.schema.world import World
from pa_console.sim.worlds.scenario_file import open_scenario
from pa_console.sim.worlds.world_file import open_world
from tests.fleets.conftest import joined, overheard, running
from tests.fleets.hostile import draw
from tests.fleets.intruder import Intruder, intruder
from tests.fleets.schemas import TOPICS, problems

NOW = datetime(2026, 3, 1, 12, 0, tzinfo=UTC)
STATE = ("Drone_T01", "state")


def told(fleet: MqttFleet, steps: int = 1) -> list[Noticed]:
    lines: list[Noticed] = []
    for _ in range(steps):
        lines += [line for line in fleet.step().told if isinstance(line, Noticed)]
    return lines


def changed(payload: bytes, **fields: Any) -> bytes:
    return json.dumps({**json.loads(payload), **fields}).encode()


def later(payload: bytes, seconds: float) -> str:
    sent = datetime.fromisoformat(json.loads(payload)["timestamp"])
    return (sent + timedelta(seconds=seconds)).isoformat()


def test_every_message_on_the_bus_is_valid_by_its_official_schema(
    world: World, address: BrokerAddress
) -> None:
    with overheard(world, address) as (ear, fleet):
        go = DeviceCommand(command_id="c1", agent="Drone_T04", verb="observe", target="EastGate")
        stop = DeviceCommand(command_id="c2", agent="Drone_T04", verb="hold")
        again = go.model_copy(update={"command_id": "c3"})
        for command in (go, stop, again, None):
            if command is not None:
                fleet.send(command)
            told(fleet, 30)
    seen = {topic.rsplit("/", 1)[1] for topic, _ in ear.all}
    assert seen >= set(TOPICS)
    for topic, payload in ear.all:
        name = topic.rsplit("/", 1)[1]
        if name in TOPICS:
            assert problems(name, payload) == [], topic


@pytest.mark.parametrize("case", ["garbage", "huge", "other's", "old", "future", "type", "second"])
def test_a_message_that_cannot_be_believed_is_told_and_changes_nothing(
    case: str, world: World, address: BrokerAddress
) -> None:
    twin = SimulatedFleet.start(world, seed=1)
    with overheard(world, address) as (evil, fleet):
        told(fleet, 20)
        topic = evil.topic(*STATE)
        true = evil.heard[topic]
        moved = {"mobileRobotPosition": {"x": 0.0, "y": 0.0, "theta": 0.0, "localized": True,
                                         "mapId": "site"}}  # fmt: skip
        match case:
            case "garbage":
                evil.send(topic, b"\xffnot json")
            case "huge":
                evil.send(topic, b" " * (MOST_BYTES + 1))
            case "other's":
                evil.send(topic, changed(true, serialNumber="Drone_T02", **moved))
            case "old":
                evil.send(topic, changed(true, timestamp=later(true, -1.0), **moved))
            case "future":
                evil.send(topic, changed(true, timestamp=later(true, 60.0), **moved))
            case "type":
                evil.send(topic, changed(true, driving="no", **moved))
            case _:
                second = evil.topic(*STATE, manufacturer="evil")
                evil.send(second, changed(true, manufacturer="evil", **moved))
        lines = told(fleet, 30)
        assert [line for line in lines if line.subject == "Drone_T01"], lines
        for _ in range(50):
            twin.step()
        assert fleet.picture() == twin.picture()


def test_a_bus_that_is_never_quiet_is_joined(world: World, address: BrokerAddress) -> None:
    with running(world, address, rate=20.0), joined(world, address) as fleet:
        told(fleet)
        assert set(fleet.picture().assets) == set(world.assets)


def test_a_state_that_the_broker_kept_is_none_of_now(world: World, address: BrokerAddress) -> None:
    with intruder(address) as evil, running(world, address, paced=True):
        with joined(world, address) as fleet:
            told(fleet, 10)
        topic = evil.topic("Drone_T01", "state")
        evil.send(topic, evil.heard[topic], retain=True)
        with joined(world, address) as fleet:
            assert "retained by the broker" in " ".join(line.text for line in told(fleet, 1))


def test_a_forged_last_will_makes_an_asset_lost_until_it_reports_again(
    world: World, address: BrokerAddress
) -> None:
    with overheard(world, address) as (evil, fleet):
        told(fleet, 9)
        topic = evil.topic("Drone_T01", "connection")
        evil.send(topic, changed(evil.heard[topic], connectionState="CONNECTION_BROKEN"))
        lines = told(fleet, 1)
        assert [line.text for line in lines] == ["its connection is broken"]
        asset = fleet.picture().assets["Drone_T01"]
        assert (asset.comms, asset.available) == ("lost", False)
        told(fleet, 5)
        asset = fleet.picture().assets["Drone_T01"]
        assert (asset.comms, asset.available) == ("degraded", True)


def test_a_robot_that_is_gone_is_lost_at_once_and_commands_to_it_are_no_secret(
    world: World, address: BrokerAddress
) -> None:
    with running(world, address, paced=True) as site:
        with joined(world, address) as fleet:
            told(fleet, 5)
        site.stop()
        with joined_without_site(world, address) as fleet:
            command = DeviceCommand(
                command_id="c1", agent="Drone_T01", verb="move_to", target="EastGate"
            )
            fleet.send(command)
            told(fleet, 5)
            asset = fleet.picture().assets["Drone_T01"]
            assert (asset.comms, asset.available) == ("lost", False)


def joined_without_site(world: World, address: BrokerAddress) -> Any:
    from contextlib import closing  # noqa: PLC0415

    from pa_console.fleets.vda5050.station_link import join  # noqa: PLC0415

    return closing(MqttFleet(world, join(address)))


@pytest.mark.parametrize("situation", ["situation-1-unauthorized", "situation-2"])
def test_a_bus_with_a_contact_in_view_is_joined(
    situation: str, world: World, address: BrokerAddress
) -> None:
    _, path = open_world("checkpoint")
    scenario = open_scenario(world, path, situation).scenario
    with running(world, address, scenario, rate=20.0):
        with joined(world, address) as fleet:
            until_tracked(fleet)
        for _ in range(10):
            with joined(world, address) as fleet:
                lines = until_tracked(fleet)
            assert not [line for line in lines if line.level == "alarm"]


def until_tracked(fleet: MqttFleet) -> list[Noticed]:
    """Step until the picture has a track; return what was reported meanwhile."""
    lines: list[Noticed] = []
    for _ in range(3000):
        lines += told(fleet)
        if fleet.picture().tracks:
            return lines
        fleet.wait(0.1)
    raise TimeoutError("no track came into the picture")


def test_a_contact_that_was_seen_an_hour_ago_and_now_ends_no_session(
    world: World, address: BrokerAddress
) -> None:
    with overheard(world, address) as (evil, fleet):
        told(fleet, 20)
        true = evil.heard[evil.topic(*STATE)]
        seen = {"signature": "x", "kind": "vehicle", "x": 0.0, "y": 60.0, "sigmaM": 1.0}
        topic = evil.topic("Drone_T01", "detections")
        for age_s in (3600.0, 0.0):
            evil.send(topic, changed(true, timestamp=later(true, -age_s), contacts=[seen]))
        lines = told(fleet, 30)
        assert [line.text for line in lines if "3600 s old" in line.text]
        assert all(track.first_seen_s >= 0.0 for track in fleet.picture().tracks.values())


def test_a_message_with_which_no_picture_can_be_made_is_left_out_and_its_sender_named(
    world: World,
) -> None:
    known, camera = ReportedPicture(world), next(iter(world.cameras))
    contact = ContactReport("x", "vehicle", (0.0, 60.0), sigma_m=1.0)
    unheard = replace(contact, signature="y", kind="tank")  # pyright: ignore[reportArgumentType]
    known.advance(5)
    for contacts in ((contact,), (unheard,)):
        known.detect(5, SensorReport(camera, NOW, contacts))
    assert known.show() == (camera,)
    assert [track.kind for track in known.picture().tracks.values()] == ["vehicle"]
    known.advance(10)
    known.detect(10, SensorReport(camera, NOW, (contact,)))
    assert known.show() == ()
    assert [track.stamp_s for track in known.picture().tracks.values()] == [1.0]


def test_hostile_messages_change_nothing_and_break_nothing(
    world: World, address: BrokerAddress
) -> None:
    assert flood(world, address, 300, seed=1) > 0


def flood(world: World, address: BrokerAddress, count: int, seed: int) -> int:
    """Send `count` hostile messages; return how many lines told of them. The picture stays true."""
    random, lines = Random(seed), 0
    twin = SimulatedFleet.start(world, seed=1)
    with overheard(world, address) as (evil, fleet):
        assert isinstance(fleet, Simulated)
        lines += len(told(fleet, 20))
        true = dict(evil.heard)
        for number in range(count):
            evil.send(*draw(random, true))
            if number % 10 == 9:
                lines += len(told(fleet))
        lines += len(told(fleet, 10 - fleet.tick % 5))
        while twin.tick < fleet.tick:
            twin.step()
        assert fleet.picture() == twin.picture()
    return lines


__all__ = ["Intruder", "flood"]
