"""One broker for the whole folder, and simulated sites on it."""

import asyncio
import re
import threading
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager

import pytest

from pa_console.fleets.station_authority import StationAuthority
from pa_console.fleets.vda5050.additions import SITE
from pa_console.fleets.vda5050.broker import BrokerAddress, Credentials
from pa_console.fleets.vda5050.mqtt_fleet import MqttFleet
from pa_console.fleets.vda5050.simulated_site import SimulatedSite, SiteOptions
from pa_console.fleets.vda5050.site_fleet import fleet_of
from pa_console.fleets.vda5050.station_link import join
from pa_console.resources import find_data
from pa_console.schema.incident import Scenario
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.worlds.world_file import load_world
from tests.fleets.broker import Broker, address_of, any_broker
from tests.fleets.intruder import Intruder, intruder

SHA = "0" * 64


@pytest.fixture(scope="session")
def broker() -> Iterator[Broker]:
    found = any_broker()
    found.start()
    yield found
    found.kill()


@pytest.fixture(scope="session")
def world() -> World:
    return load_world(find_data("worlds", "checkpoint", "world.yaml"))


@pytest.fixture
def address(broker: Broker, request: pytest.FixtureRequest) -> BrokerAddress:
    """A site of the test's own."""
    name = str(request.node.name)  # pyright: ignore[reportUnknownMemberType, reportUnknownArgumentType]
    return address_of(broker, re.sub(r"\W", "_", name)[:60])


class RunningSite:
    """A site in a thread of its own."""

    def __init__(self, site: Callable[[], SimulatedSite]) -> None:
        self._loop = asyncio.new_event_loop()
        self._task: asyncio.Task[None] | None = None
        self._made = threading.Event()
        self._make = site
        self.site: SimulatedSite
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        self._made.wait(300)

    def _run(self) -> None:
        self._loop.run_until_complete(self._go())

    async def _go(self) -> None:
        self.site = self._make()
        self._task = asyncio.create_task(self.site.run())
        self._made.set()
        await asyncio.gather(self._task, return_exceptions=True)

    def stop(self) -> None:
        """Take everybody off the bus in good order."""
        if self._task is not None:
            self._loop.call_soon_threadsafe(self._task.cancel)
        self._thread.join(300)


@contextmanager
def running(
    world: World,
    address: BrokerAddress,
    scenario: Scenario | None = None,
    seed: int = 1,
    **options: object,
) -> Generator[RunningSite]:
    def make() -> SimulatedSite:
        checkpoint = Checkpoint(world, seed, scenario)
        return SimulatedSite(checkpoint, address, SiteOptions(SHA, **options))  # pyright: ignore[reportArgumentType]

    site = RunningSite(make)
    try:
        yield site
    finally:
        site.stop()


@contextmanager
def joined(
    world: World,
    address: BrokerAddress,
    keys: StationAuthority | None = None,
    credentials: Credentials | None = None,
) -> Generator[MqttFleet]:
    """Yield the fleet of the site at `address`, once the site is there."""
    for _ in range(20):
        found = join(address, credentials)
        if found.site is not None and SITE in found.online:
            break
        found.link.close()
    else:
        raise TimeoutError(f"no site at {address}")
    fleet = fleet_of(found, world, SHA, keys)
    try:
        yield fleet
    finally:
        fleet.close()


@contextmanager
def overheard(world: World, address: BrokerAddress) -> Generator[tuple[Intruder, MqttFleet]]:
    """Yield an intruder and the fleet of a paced site that both are on."""
    with (
        intruder(address) as ear,
        running(world, address, paced=True),
        joined(world, address) as fleet,
    ):
        yield ear, fleet
