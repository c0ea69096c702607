"""A vehicle of another house, of version 2 of the standard, understands what we send and is heard.

Version 2 names some things otherwise; the reader here puts one into the words of the other.
"""

import asyncio
import json
from datetime import UTC, datetime
from typing import Any

import pytest
from vda5050.config import VehicleConfig
from vda5050.testing.fake_agv import FakeAgv
from vda5050.testing.memory_transport import MemoryBroker, MemoryTransport
from vda5050.validation.schema_validator import default_validator

from pa_console.fleets.vda5050 import commands, messages
from pa_console.fleets.vda5050.asset_state import telemetry_of
from pa_console.fleets.vda5050.wire import Identity, Numbers
from pa_console.schema.command import DeviceCommand
from pa_console.schema.world import World
from pa_console.sim.worlds.terrain import Terrain

VEHICLE = Identity("acme", "Ugv_T01")
TOPIC = "uagv/v2/acme/Ugv_T01"
ORDER = DeviceCommand(command_id="c1", agent="Ugv_T01", verb="block", target="EastGate")


def order_in_version_two(order: messages.Order) -> dict[str, Any]:
    """An order of ours in the words of version 2."""
    said: dict[str, Any] = json.loads(order.write())
    names = [node["nodeId"] for node in said["nodes"]]
    for edge, start, end in zip(said["edges"], names, names[1:], strict=False):
        edge |= {"startNodeId": start, "endNodeId": end}
    return said | {"version": "2.1.0"}


def state_from_version_two(payload: bytes) -> messages.RobotState:
    """A state of version 2 in our words."""
    said: dict[str, Any] = json.loads(payload)
    place, battery, safety = said["agvPosition"], said["batteryState"], said["safetyState"]
    stop = safety["eStop"]
    moved: dict[str, Any] = {
        "version": "3.0.0",
        "instantActionStates": [],
        "mobileRobotPosition": place | {"localized": place["positionInitialized"]},
        "powerSupply": {
            "stateOfCharge": battery["batteryCharge"],
            "charging": battery["charging"],
        },
        "safetyState": {
            "activeEmergencyStop": "MANUAL" if stop == "AUTOACK" else stop,
            "fieldViolation": safety["fieldViolation"],
        },
    }
    return messages.RobotState.read(json.dumps(said | moved).encode())


def order_of(world: World, at: tuple[float, float], frame: str) -> messages.Order:
    nodes, edges = commands.order_of(ORDER, world, at, frame, "token")
    header = Numbers().header(VEHICLE, "order", datetime.now(UTC))
    return messages.Order(**header, order_id="c1", order_update_id=0, nodes=nodes, edges=edges)


async def said_by_vehicle(world: World, order: dict[str, Any]) -> list[messages.RobotState]:
    """What a vehicle at the base says once it was sent `order`."""
    x, y = world.frames[world.base].at
    broker, master = MemoryBroker(), MemoryTransport()
    broker.attach(master)
    states: list[messages.RobotState] = []

    async def hear(_topic: str, payload: bytes) -> None:
        states.append(state_from_version_two(payload))

    await master.connect()
    await master.subscribe(f"{TOPIC}/state", hear)
    config = VehicleConfig(manufacturer="acme", serial_number="Ugv_T01", validate_messages=True)
    vehicle = FakeAgv(
        config, broker, initial_node_id=world.base, start_x=x, start_y=y, start_map_id="site"
    )
    await vehicle.start()
    await master.publish(f"{TOPIC}/order", json.dumps(order).encode())
    async with asyncio.timeout(300):
        while not any(commands.answer_of("c1", "block", state) for state in states):
            await vehicle.client.publish_state()
    await vehicle.client.publish_state()
    await vehicle.stop()
    return states


async def test_it_takes_an_order_and_its_states_are_answers(world: World) -> None:
    order = order_in_version_two(order_of(world, world.frames[world.base].at, world.base))
    states = await said_by_vehicle(world, order)
    answers = [commands.answer_of("c1", "block", state) for state in states]
    assert [answer.status for answer in answers if answer is not None][-1] == "done"
    told = telemetry_of(states[-1], "Ugv_T01", "ugv", Terrain(world), 0.0)
    assert told is not None
    assert (told.id, told.status) == ("Ugv_T01", "ok")


async def test_its_refusal_is_one(world: World) -> None:
    order = order_in_version_two(order_of(world, world.frames["WestGate"].at, "WestGate"))
    states = await said_by_vehicle(world, order)
    answer = commands.answer_of("c1", "block", states[-1])
    assert answer is not None
    assert answer.status == "refused"
    assert "not trivially reachable" in answer.detail


@pytest.mark.parametrize("verb", ["move_to", "observe", "identify", "warn", "block"])
def test_every_order_is_valid_by_the_schema_of_version_two(world: World, verb: str) -> None:
    order = order_of(world, (0.0, 0.0), "")
    said = order_in_version_two(order)
    said["nodes"][-1]["actions"][0]["actionType"] = verb
    default_validator().validate("order", said)
