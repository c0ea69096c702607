"""A session can end at any moment, also while the model's process is being started."""

import asyncio
from contextlib import aclosing

import pytest

from pa_console.llm.local.engine import Engine
from pa_console.llm.models.catalogue import Catalog
from pa_console.llm.models.fetching import pull
from pa_console.station.assembly import Site, open_station
from pa_console.station.clock import SteppedClock


@pytest.mark.parametrize("events", [1, 2, 3])
async def test_leaving_while_the_model_starts_leaves_no_process_behind(
    site: Site, events: int
) -> None:
    catalog = Catalog.load()
    pull(catalog.get("smollm2-135m"))
    engine = Engine(catalog.locate("smollm2-135m"))
    station = open_station(site, engine, SteppedClock())
    seen = 0
    async with asyncio.timeout(300), aclosing(station.run()) as stream:
        async for _ in stream:
            seen += 1
            if seen == events:
                break
    assert engine.pid is None
