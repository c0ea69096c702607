"""Every message that we send is valid by the official schema of its topic, and is read back."""

import json
from datetime import UTC, datetime
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.fleets.vda5050 import commands, messages
from pa_console.fleets.vda5050.asset_state import state_of, telemetry_of
from pa_console.fleets.vda5050.gateway import factsheet_of, offers
from pa_console.fleets.vda5050.messages import Factsheet
from pa_console.fleets.vda5050.mqtt_fleet import zone_set
from pa_console.fleets.vda5050.vehicle import Vehicle
from pa_console.fleets.vda5050.wire import MOST_BYTES, Header, Identity, UnreadableError
from pa_console.schema.command import COMMANDS, CommandReply, DeviceCommand
from pa_console.schema.telemetry import AssetTelemetry
from pa_console.schema.world import KINDS, World
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.worlds.terrain import Terrain
from tests.fleets.schemas import problems

NOW = datetime(2026, 3, 1, 12, 0, 0, 500_000, UTC)
DRONE = Identity("pa-console", "Drone_T01")
HEADER: dict[str, Any] = {
    "header_id": 1,
    "timestamp": NOW,
    "manufacturer": DRONE.manufacturer,
    "serial_number": DRONE.serial_number,
}


def assert_valid(message: Header) -> None:
    assert problems(message.TOPIC, message.write()) == []
    assert type(message).read(message.write()) == message


@pytest.mark.parametrize("word", ["ONLINE", "OFFLINE", "HIBERNATING", "CONNECTION_BROKEN"])
def test_connection(word: messages.ConnectionState) -> None:
    assert_valid(messages.RobotConnection(**HEADER, connection_state=word))


@pytest.mark.parametrize("kind", KINDS)
def test_factsheet(kind: Any, world: World) -> None:
    sheet = factsheet_of(kind, world, HEADER)
    assert_valid(sheet)
    for verb in offers(kind) - {"hold"}:
        assert sheet.offers(verb)
    assert sheet.offers("block") == (kind == "ugv")


def test_zone_set(world: World) -> None:
    assert_valid(zone_set(world, HEADER))


@pytest.mark.parametrize("verb", COMMANDS)
@pytest.mark.parametrize("token", [None, "a.b.c"])
def test_every_command(verb: Any, token: str | None, world: World) -> None:
    target = "EastGate" if COMMANDS[verb].takes_frame else None
    command = DeviceCommand(command_id="M1.1", agent="Drone_T01", verb=verb, target=target)
    if commands.is_order(command):
        for at in (None, (3.0, -4.5)):
            nodes, edges = commands.order_of(command, world, at, "WestGate", token)
            assert_valid(
                messages.Order(
                    **HEADER, order_id="M1.1", order_update_id=0, nodes=nodes, edges=edges
                )
            )
    else:
        actions = commands.actions_at_once(command, token)
        assert_valid(messages.InstantActions(**HEADER, actions=actions))
    extra = (commands.resume_for(command), commands.cancel_before(command))
    assert_valid(messages.InstantActions(**HEADER, actions=extra))


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 50),
    steps=st.integers(0, 60),
    verb=st.sampled_from(sorted(offers("uav"))),
    answers=st.lists(st.sampled_from(("acknowledged", "progress", "done", "failed", "refused"))),
)
def test_state_of_whatever_an_asset_is_at(
    seed: int, steps: int, verb: Any, answers: list[Any], world: World
) -> None:
    simulation = Checkpoint(world, seed)
    target = "EastGate" if COMMANDS[verb].takes_frame else None
    command = DeviceCommand(command_id="M1.1", agent="Drone_T01", verb=verb, target=target)
    simulation.send(command)
    for _ in range(steps):
        simulation.step()
    vehicle = Vehicle(DRONE, offers("uav"), lambda: NOW)
    if commands.is_order(command):
        nodes, edges = commands.order_of(command, world, None, "", None)
        order = messages.Order(
            **HEADER, order_id="M1.1", order_update_id=0, nodes=nodes, edges=edges
        )
        assert list(vehicle.take_order(order)) == [command]
    else:
        actions = commands.actions_at_once(command, None)
        assert list(vehicle.take_actions(messages.InstantActions(**HEADER, actions=actions))) == [
            command
        ]
    for status in answers:
        reply = CommandReply(
            command_id="M1.1", agent="Drone_T01", status=status, tick=0, detail="so it is"
        )
        vehicle.hear(reply)
    said = simulation.picture().assets["Drone_T01"]
    state = state_of(said, vehicle, 7, NOW)
    assert_valid(state)
    assert read_again(state, said, world) == said


@pytest.mark.parametrize(
    ("mode", "status", "manual"),
    [
        ("AUTOMATIC", "ok", False), ("SEMIAUTOMATIC", "ok", False), ("MANUAL", "ok", True),
        ("INTERVENED", "ok", True), ("TEACH_IN", "ok", True), ("STARTUP", "failed", False),
        ("SERVICE", "failed", False),
    ],
)  # fmt: skip
def test_an_operating_mode_tells_whether_somebody_drives_a_robot(
    world: World, mode: str, status: str, manual: bool
) -> None:
    said = Checkpoint(world).picture().assets["Drone_T01"]
    vehicle = Vehicle(DRONE, offers("uav"), lambda: NOW)
    state = state_of(said, vehicle, 7, NOW).model_copy(update={"operating_mode": mode})
    found = telemetry_of(state, said.id, said.kind, Terrain(world), said.stamp_s)
    assert found is not None
    assert (found.status, found.manual) == (status, manual)
    assert found.available == (status == "ok" and not manual)
    driven = state_of(found, vehicle, 8, NOW)
    assert driven.operating_mode == ("MANUAL" if manual else "AUTOMATIC")
    assert_valid(driven)


def read_again(state: messages.RobotState, said: AssetTelemetry, world: World) -> AssetTelemetry:
    terrain = Terrain(world)
    found = telemetry_of(state, said.id, said.kind, terrain, said.stamp_s)
    assert found is not None
    heading_for_its_order = {"command_id": said.command_id, "post": said.post, "route": said.route}
    return found.model_copy(update=heading_for_its_order)


def connection(**changed: object) -> bytes:
    fields: dict[str, object] = {
        "headerId": 1,
        "timestamp": "2026-03-01T12:00:00.000Z",
        "version": "3.0.0",
        "manufacturer": "m",
        "serialNumber": "s",
        "connectionState": "ONLINE",
    }
    fields.update(changed)
    present = {key: value for key, value in fields.items() if value is not None}
    return json.dumps(present).encode()


def test_what_a_manufacturer_adds_is_left_out() -> None:
    assert messages.RobotConnection.read(connection(colour="red")).connection_state == "ONLINE"


@pytest.mark.parametrize(
    ("payload", "why"),
    [
        (b"", "Invalid JSON"),
        (b"[" * 100_000, "recursion"),
        (b"\xff\xfe", "Invalid JSON"),
        (b"7", "object"),
        (b" " * (MOST_BYTES + 1), "bytes"),
        (connection(headerId=None), "headerId"),
        (connection(headerId="1"), "headerId"),
        (connection(headerId=-1), "headerId"),
        (connection(headerId=float("nan")), "headerId"),
        (connection(timestamp=1772366400), "timestamp"),
        (connection(timestamp="2026-03-01T12:00:00"), "timestamp"),
        (connection(version="2.1.0"), "only 3"),
        (connection(serialNumber="a/b"), "serialNumber"),
        (connection(serialNumber="a" * 65), "serialNumber"),
        (connection(connectionState="ASLEEP"), "connectionState"),
    ],
)
def test_what_is_no_message_is_unreadable_and_says_why(payload: bytes, why: str) -> None:
    with pytest.raises(UnreadableError, match=why):
        messages.RobotConnection.read(payload)


@settings(deadline=None)
@given(st.binary(max_size=300) | st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(
        st.sampled_from(["headerId", "actions", "nodes", "timestamp", "version", "x"]), inner
    ),
    max_leaves=20,
).map(lambda value: json.dumps(value).encode()))  # fmt: skip
def test_nothing_that_comes_breaks_the_reader(payload: bytes) -> None:
    for kind in (messages.RobotState, messages.Order, messages.InstantActions, Factsheet):
        with pytest.raises(UnreadableError):
            kind.read(payload)
