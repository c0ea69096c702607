"""The checkpoint, put somewhere on the open sea, and a TAK server for the folder."""

from collections.abc import Iterator

import pytest

from pa_console.resources import find_data
from pa_console.schema.world import Origin, World
from pa_console.sim.worlds.geography import Geography
from pa_console.sim.worlds.world_file import load_world
from pa_console.tak.session_on_map import SiteOnMap
from tests.fleets.broker import Broker, any_broker
from tests.tak.taky_server import Taky


@pytest.fixture(scope="session")
def world() -> World:
    return load_world(find_data("worlds", "checkpoint", "world.yaml"))


@pytest.fixture(scope="session")
def site(world: World) -> SiteOnMap:
    origin = Origin(latitude=2.0, longitude=-30.0, bearing=15.0, altitude=12.0)
    return SiteOnMap(world, Geography(origin), "sea")


@pytest.fixture(scope="module")
def taky(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Taky]:
    with Taky(tmp_path_factory.mktemp("taky")) as server:
        yield server


@pytest.fixture(scope="module")
def broker() -> Iterator[Broker]:
    found = any_broker()
    found.start()
    yield found
    found.kill()
