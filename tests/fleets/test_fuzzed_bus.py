"""Whatever comes from the bus, the session goes on, and STOP goes out."""

import asyncio
import os
from collections.abc import Callable
from datetime import UTC, datetime
from random import Random

import pytest

from pa_console.fleets.vda5050.broker import BrokerAddress, IncomingMessage, OutgoingMessage
from pa_console.fleets.vda5050.mqtt_fleet import MqttFleet
from pa_console.fleets.vda5050.station_link import FROM_PEOPLE, TELEMETRY, JoinedBus, StationLink
from pa_console.schema.events import event as ev
from pa_console.schema.world import World
from pa_console.station.assembly import Site, load_site, open_station
from tests.fleets.conftest import overheard
from tests.fleets.hostile import absurd, draw
from tests.scripted import ScriptedEngine

MESSAGES = int(os.environ.get("PA_FUZZED_MESSAGES", "10000"))
"""A campaign by hand takes 50,000."""

A_STEP = 25


class Link(StationLink):
    """A link without a broker: the test delivers, and looks at what goes out."""

    def __init__(self, address: BrokerAddress) -> None:
        self.out: list[OutgoingMessage] = []
        super().__init__(address, "fuzz", ())
        self.limit = None
        self._kinds = {kind.TOPIC: kind for kind in (*FROM_PEOPLE, *TELEMETRY)}

    @property
    def problem(self) -> str:
        """None: the test is the broker."""
        return ""

    def publish(self, *messages: OutgoingMessage) -> bool:
        """Keep what goes out."""
        self.out += messages
        return True

    def deliver(self, topic: str, payload: bytes) -> None:
        """Let a message come."""
        self._heard(self._kinds, IncomingMessage(topic, payload, False))


class Steps:
    """A clock that steps as fast as it can; before each step it calls `before`."""

    waits, rate = False, 1.0

    def __init__(self, before: Callable[[], None]) -> None:
        self._before = before

    async def due(self, dt_s: float, waiting: Callable[[], bool]) -> int:
        """Return one step."""
        await asyncio.sleep(0)
        self._before()
        return 1


def true_messages(world: World, address: BrokerAddress) -> dict[str, bytes]:
    """What a site sends, by topic."""
    with overheard(world, address) as (ear, fleet):
        for _ in range(20):
            fleet.step()
        return dict(ear.heard)


@pytest.mark.long
async def test_no_message_ends_the_session_or_keeps_a_stop_in(
    world: World, address: BrokerAddress
) -> None:
    random, heard = Random(1), true_messages(world, address)
    site: Site = load_site("checkpoint", "checkpoint")
    link = Link(address)
    fleet = MqttFleet(site.world, JoinedBus(link, None, {}, frozenset(), ()))
    for topic, payload in heard.items():
        link.deliver(topic, payload)
    left = MESSAGES

    def flood() -> None:
        nonlocal left
        for _ in range(min(A_STEP, left)):
            hostile = random.random() < 0.3
            now = datetime.now(UTC)
            link.deliver(*(draw(random, heard) if hostile else absurd(random, heard, now)))
            left -= 1

    station = open_station(
        site, ScriptedEngine([]).engine(), Steps(flood), fleet=fleet, read_unasked=False
    )
    faults: list[str] = []
    pictures = 0
    async for event in station.run():
        match event.data:
            case ev.Noticed(text=text) if "internal error" in text or "is set aside:" in text:
                faults.append(text)
            case ev.TelemetryReceived():
                pictures += 1
            case _:
                pass
        if left <= 0:
            break
    assert faults == []
    assert station.failure == ""
    assert pictures >= MESSAGES // A_STEP // 5
    link.out.clear()
    station.stop_all()
    stopped = {
        message.topic.split("/")[3] for message in link.out if b"startPause" in message.payload
    }
    assert stopped == set(site.world.assets)
