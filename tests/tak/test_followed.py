"""The session that is followed: over a bus while it lasts, or as it was recorded."""

import asyncio
import threading
import time
from pathlib import Path

from pa_console.cli.sessions.on_map import JoinedEvents
from pa_console.fleets import authorization as auth
from pa_console.fleets.station_authority import Keys, StationAuthority
from pa_console.fleets.vda5050.sharing import SharedSession
from pa_console.fleets.vda5050.station_link import StationLink
from pa_console.schema.events import event as ev
from pa_console.schema.world import World
from pa_console.session.log.writer import LogWriter
from pa_console.station.assembly import load_site, open_station
from pa_console.station.clock import DevicesClock
from pa_console.station.joined.shared_log import HEARD, SharedLog, read_so_far
from tests.fleets.broker import Broker, address_of
from tests.fleets.conftest import joined, running
from tests.fleets.keyring import KEYS, PUBLIC, ROSTER, TO_NORTH
from tests.fleets.test_shared_session import LIMIT_S, RATE, Watched, until
from tests.scripted import ScriptedEngine, plan

ROSTER_SIGNED = auth.sign_roster(KEYS["owner"], ROSTER)


async def test_a_shared_session_is_followed_from_its_last_picture_to_its_end(
    world: World, broker: Broker, tmp_path: Path
) -> None:
    address = address_of(broker, "followed")
    keys = Keys(KEYS["north"], "ann", KEYS["ann"], PUBLIC["owner"], (ROSTER_SIGNED, TO_NORTH))
    authority = StationAuthority(keys)
    engine = ScriptedEngine([plan(("Ugv_T02", "hold"))]).engine()
    with running(world, address, rate=RATE), joined(world, address, authority) as fleet:
        station = open_station(
            load_site("checkpoint", "checkpoint"),
            engine,
            DevicesClock(RATE),
            fleet=fleet,
            authority=authority,
            read_unasked=False,
        )
        log = LogWriter(tmp_path / "log.jsonl", station.session)
        shared = SharedSession(station.session, authority.name, log.path, authority.vouch)
        log.on_record = shared.add
        fleet.share(shared)
        station.write_to(log)
        ann = Watched(station)
        await until(lambda: [e.data.kind for e in ann.events].count("telemetry") > 3)
        followed = await asyncio.to_thread(_follow, address_of(broker, "followed"), world)
        seen: list[ev.Event] = []
        watching = asyncio.create_task(asyncio.to_thread(_watch, followed, seen))
        await until(lambda: sum(event.data.kind == "telemetry" for event in seen) > 3)
        await station.close()
        await asyncio.wait_for(watching, LIMIT_S)
        await ann.task
        log.close()
    kinds = [event.data.kind for event in seen]
    assert (kinds[0], kinds[-1]) == ("session_started", "session_ended")
    first = kinds.index("telemetry")
    before = [e for e in ann.events if e.data.kind == "telemetry" and e.t < seen[first].t]
    assert before, "older pictures are told no more"
    assert "north" in followed.title


def _follow(address: object, world: World) -> JoinedEvents:
    link = StationLink(address, "tak", HEARD)  # pyright: ignore[reportArgumentType]
    log = SharedLog(link, auth.Trust(PUBLIC["owner"]), len)
    return JoinedEvents(log, read_so_far(log, lambda _d, _t: None), world, print)


def _watch(followed: JoinedEvents, seen: list[ev.Event]) -> None:
    end = time.monotonic() + LIMIT_S
    over = threading.Event()
    for event in followed.events(over.is_set):
        if event is not None:
            seen.append(event)
        if time.monotonic() > end:
            over.set()
