"""A broker that loses half of all messages keeps no stop from a robot."""

import time
from dataclasses import replace

from pa_console.fleets.vda5050.broker import BrokerAddress
from pa_console.schema.world import World
from tests.fleets.broker import Broker, Lossy
from tests.fleets.conftest import running
from tests.fleets.intruder import Intruder, intruder
from tests.fleets.stop_campaign import RATE, Session

LIMIT_S = 300.0
"""What has not happened by then never will, also on a busy machine."""


def held(ear: Intruder) -> set[str]:
    """Return the robots for which a stop was on the wire."""
    return {
        topic.split("/")[3]
        for topic, payload in list(ear.all)
        if topic.endswith("/instantActions") and b"startPause" in payload
    }


def test_stop_is_repeated_until_it_has_come_through_to_every_robot(
    world: World, broker: Broker, address: BrokerAddress
) -> None:
    with (
        running(world, address, rate=RATE) as site,
        intruder(address) as ear,
        Lossy(broker, 0.5, seed=1) as lossy,
    ):

        def moving() -> list[str]:
            assets = site.site.checkpoint.truth().assets
            return [name for name, asset in assets.items() if asset.speed_mps > 0.0]

        session = Session(world, replace(address, port=lossy.port))
        for name in ("Drone_T04", "Ugv_T02"):
            session.order(name, "NorthGate")
        session.go(0.5)
        session.stop()
        until = time.monotonic() + LIMIT_S
        while held(ear) != set(world.assets) or moving():
            assert time.monotonic() < until, (held(ear), moving())
            session.step()
        session.fleet.close()
        assert lossy.lost > len(world.assets)
