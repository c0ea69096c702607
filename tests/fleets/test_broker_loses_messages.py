"""A broker that loses half of all messages keeps no stop from a robot."""

from dataclasses import replace

from pa_console.fleets.vda5050.broker import BrokerAddress
from pa_console.schema.world import World
from tests.fleets.broker import Broker, Lossy
from tests.fleets.conftest import running
from tests.fleets.stop_campaign import RATE, Session

MOST_STEPS = 3000


def test_stop_is_repeated_until_every_robot_stands_and_is_seen_to(
    world: World, broker: Broker, address: BrokerAddress
) -> None:
    with running(world, address, rate=RATE) as site, Lossy(broker, 0.5, seed=1) as lossy:
        session = Session(world, replace(address, port=lossy.port))
        for name in ("Drone_T04", "Ugv_T02"):
            session.order(name, "NorthGate")
        session.go(0.5)
        session.stop()
        steps = 0
        while session.stops.waiting and steps < MOST_STEPS:
            session.step()
            steps += 1
        session.fleet.close()
        assert not session.stops.waiting
        assert lossy.lost > len(world.assets)
        assets = site.site.checkpoint.truth().assets
        assert [name for name, asset in assets.items() if asset.speed_mps > 0.0] == []
