"""A commander at a joined console takes command: vehicles follow, and the first station is told."""

import asyncio
import time
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import pytest

from pa_console.fleets import authorization as auth
from pa_console.fleets.station_authority import Keys, StationAuthority, Vehicles
from pa_console.fleets.vda5050.additions import SIGNED, SignedTakeover
from pa_console.fleets.vda5050.broker import BrokerAddress
from pa_console.fleets.vda5050.mqtt_fleet import MqttFleet
from pa_console.fleets.vda5050.sharing import SharedSession, signed_messages
from pa_console.fleets.vda5050.station_link import StationLink
from pa_console.fleets.vda5050.wire import Numbers
from pa_console.schema.events import event as ev
from pa_console.schema.incident import Scenario
from pa_console.schema.mission import Decision
from pa_console.schema.world import World
from pa_console.session.log.chain import read_log
from pa_console.session.log.writer import LogWriter
from pa_console.sim.worlds.scenario_file import open_scenario
from pa_console.sim.worlds.world_file import open_world
from pa_console.station.assembly import Site, open_station
from pa_console.station.clock import DevicesClock
from pa_console.station.joined.joined_station import JoinedStation, Signatory, Succession
from pa_console.station.joined.shared_log import HEARD, SharedLog, read_so_far
from pa_console.station.station import ControlStation
from tests.fleets.conftest import joined, running
from tests.fleets.keyring import KEYS, PUBLIC, TO_NORTH
from tests.fleets.test_shared_session import (
    RATE,
    Watched,
    messages,
    patient,
    two_people,
    until,
)
from tests.scripted import ScriptedEngine, plan

SENT = datetime(2026, 1, 1, tzinfo=UTC)
MOVE = plan(("Drone_T04", "move_to EastGate"))
TEXT = "Move Drone_T04 to the east gate."
NEXT = "Send Drone_T04 to the north gate."


@pytest.fixture(scope="module", name="world")
def patient_world(world: World) -> World:
    """The world of the folder, with patience."""
    return patient(world)


def keys(station: str, person: str, site: Site) -> Keys:
    return Keys(KEYS[station], person, KEYS[person], PUBLIC["owner"], messages(site))


def own_station(site: Site, authority: StationAuthority, **how: object) -> ControlStation:
    """A station with a model of its own."""
    engine = ScriptedEngine([MOVE]).engine()
    clock = DevicesClock(RATE)
    return open_station(
        site, engine, clock, authority=authority, read_unasked=False, **how  # pyright: ignore[reportArgumentType]
    )  # fmt: skip


async def approved(watched: Watched, station: ControlStation) -> ev.DecisionMade:
    """Give a mission, approve its plan, and return what became of that."""
    count = len(watched.events)
    station.submit(TEXT)
    await until(lambda: watched.request)
    request = watched.request
    assert request is not None
    if request.blocked_by:
        station.decide(Decision(kind="reject", reason="blocked"))
    else:
        station.decide(Decision(kind="approve", reason="seen", acknowledged=request.acknowledge))
    await until(lambda: watched.state.active is None and watched.request is None)
    made = [e.data for e in watched.events[count:] if isinstance(e.data, ev.DecisionMade)]
    return made[-1]


def succession_of(
    address: BrokerAddress, person: str, site: Site, own: StationAuthority | None = None
) -> tuple[StationLink, JoinedStation, Succession]:
    """What a console has that joined, at which `person` sits, with the key of south."""
    link = StationLink(address, person, HEARD)
    log = SharedLog(link, auth.Trust(PUBLIC["owner"]), len)
    before = read_so_far(log, lambda _done, _total: None)
    signatory = Signatory(person, KEYS[person])
    station = JoinedStation(log, before, signatory, site.world, site.rulebook)

    def its() -> StationAuthority:
        return own or StationAuthority(keys("south", person, site))

    return link, station, Succession(log, signatory, its)


@asynccontextmanager
async def shared(
    site: Site, authority: StationAuthority, fleet: MqttFleet, folder: Path
) -> AsyncGenerator[tuple[ControlStation, Watched, LogWriter]]:
    """The session of a station, watched, shared on the bus and written to a log."""
    station = own_station(site, authority, fleet=fleet)
    log = LogWriter(folder / f"{authority.name}.jsonl", station.session)
    session = SharedSession(station.session, authority.name, log.path, authority.vouch)
    log.on_record = session.add
    fleet.share(session)
    station.write_to(log)
    watched = Watched(station)
    try:
        yield station, watched, log
    finally:
        await station.close()
        await watched.task
        log.close()


class Begun(NamedTuple):
    """The session of the station that is in command, and the vehicles that check who is."""

    site: Site
    authority: StationAuthority
    vehicles: Vehicles
    station: ControlStation
    watched: Watched
    log: LogWriter


@asynccontextmanager
async def north_commands(
    world: World, address: BrokerAddress, folder: Path, scenario: Scenario | None = None
) -> AsyncGenerator[Begun]:
    """North's session, with Ann at it, as soon as it has a picture."""
    site = two_people(folder)
    vehicles = Vehicles(world.assets, PUBLIC["owner"], (), time.time)
    authority = StationAuthority(keys("north", "ann", site))
    with (
        running(world, address, scenario, rate=RATE, verify=vehicles.verify, take=vehicles.take),
        joined(world, address, authority) as fleet,
    ):
        async with shared(site, authority, fleet, folder) as (station, watched, log):
            await until(lambda: watched.state.picture)
            yield Begun(site, authority, vehicles, station, watched, log)


@asynccontextmanager
async def in_its_place(
    world: World, address: BrokerAddress, site: Site
) -> AsyncGenerator[tuple[ControlStation, Watched]]:
    """The session of south, as Cleo begins it at a console that had joined and takes command."""
    link, there, succession = await asyncio.to_thread(succession_of, address, "cleo", site)
    authority = succession.prepare(there.started)
    with joined(world, address, authority) as fleet:
        south = own_station(site, authority, fleet=fleet)
        taken = succession.take(fleet.publish_signed)
        south.succeed(taken, there.left_missions(succession.last))
        watched = Watched(south)
        yield south, watched
        await south.close()
        await watched.task
    link.close()


async def test_command_goes_over_with_no_moment_in_which_both_have_it(
    world: World, address: BrokerAddress, tmp_path: Path
) -> None:
    async with north_commands(world, address, tmp_path) as begun:
        site, first, vehicles = begun.site, begun.authority, begun.vehicles
        north, ann, log = begun.station, begun.watched, begun.log
        assert (await approved(ann, north)).accepted

        link, cleos, succession = await asyncio.to_thread(succession_of, address, "cleo", site)
        second = succession.prepare(cleos.started)
        question = cleos.command_question(second.trust.next_epoch, second.name)
        assert "Put south in command in place of north? The epoch rises to 2." in question
        with joined(world, address, second) as other:
            south = own_station(site, second, fleet=other)
            assert first.refusal == "", "what is prepared takes nothing"
            assert "south" not in vehicles.in_command
            taken = succession.take(other.publish_signed)
            south.succeed(taken, cleos.left_missions(succession.last))
            own_log = LogWriter(tmp_path / "south.jsonl", south.session)
            south.write_to(own_log)
            cleo = Watched(south)
            await until(lambda: ann.state.relieved and "south" in vehicles.in_command)
            assert "south is in command since epoch 2" in ann.state.relieved
            relieved = await approved(ann, north)
            assert relieved.decision.kind == "reject", "its plan was blocked"
            assert (await approved(cleo, south)).accepted
            missions = [trace.status for trace in cleo.state.missions.values()]
            assert missions == ["verified"]
            await south.close()
            await cleo.task
            own_log.close()
        link.close()
    told = [event.data for event in read_log(own_log.path)]
    assert [data for data in told if isinstance(data, ev.CommandTaken)] == [taken]
    first_told = [data.kind for data in told if data.kind != "log_signed"][:2]
    assert first_told == ["session_started", "command_taken"]
    lines = log.path.read_text("utf-8").splitlines()
    assert f'"hash":"{taken.head}"' in lines[taken.records - 1], "the other log's head was there"
    assert (taken.station, taken.session, taken.epoch) == ("north", north.session, 2)


@pytest.mark.parametrize(
    ("person", "said"),
    [
        ("bob", "only a commander can take command, and bob is not a commander"),
        ("cleo", "is in command already"),
    ],
)
async def test_why_command_cannot_be_taken_is_said_before_anything_is_done(
    world: World, address: BrokerAddress, tmp_path: Path, person: str, said: str
) -> None:
    site = two_people(tmp_path)
    south = StationAuthority(keys("south", "cleo", site))
    south.take_command("cleo", KEYS["cleo"])
    with running(world, address), joined(world, address, south) as fleet:
        async with shared(site, south, fleet, tmp_path):
            link, there, succession = await asyncio.to_thread(
                succession_of, address, person, site, south
            )
            assert succession.possible == (person == "cleo")
            with pytest.raises(ValueError, match=said):
                succession.prepare(there.started)
            link.close()


async def test_a_mission_that_has_moved_nobody_waits_where_command_was_taken(
    world: World, address: BrokerAddress, tmp_path: Path
) -> None:
    async with north_commands(world, address, tmp_path) as begun:
        site, north, ann = begun.site, begun.station, begun.watched
        north.submit(TEXT)
        north.submit(NEXT)
        await until(lambda: ann.request)
        async with in_its_place(world, address, site) as (south, cleo):
            await until(lambda: cleo.request)
            texts = [trace.mission.text for trace in cleo.state.missions.values()]
            assert texts == [TEXT, NEXT]
            assert not [e for e in cleo.events if isinstance(e.data, ev.CommandSent)]
            south.decide(Decision(kind="approve", reason="seen"))
            first_one = next(iter(cleo.state.missions.values()))
            await until(lambda: first_one.status)
            assert first_one.status == "verified"


async def test_whom_the_first_station_had_stopped_stays_stopped(
    world: World, address: BrokerAddress, tmp_path: Path
) -> None:
    async with north_commands(world, address, tmp_path) as begun:
        site, north, ann = begun.site, begun.station, begun.watched
        north.stop_all()
        await until(lambda: ann.state.stop)
        async with in_its_place(world, address, site) as (south, cleo):
            await until(lambda: cleo.state.stop and not cleo.state.stop.unconfirmed)
            with pytest.raises(ValueError, match="stopped"):
                south.submit(TEXT)
            told = [notice.text for notice in cleo.state.notices]
            assert "north had stopped every asset: all stay stopped until you release them" in told


async def test_command_is_taken_and_the_team_stopped_while_a_contact_is_in_view(
    world: World, address: BrokerAddress, tmp_path: Path
) -> None:
    _, path = open_world("checkpoint")
    scenario = open_scenario(world, path, "situation-2").scenario
    async with north_commands(world, address, tmp_path, scenario) as begun:
        await until(lambda: begun.watched.state.picture and begun.watched.state.picture.tracks)
        async with in_its_place(world, address, begun.site) as (south, cleo):
            await until(lambda: cleo.state.picture and cleo.state.picture.tracks)
            south.stop_all("cleo")
            await until(lambda: cleo.state.stop and cleo.state.stop.held == len(world.assets))
            assert not cleo.state.ended
            assert south.failure == ""


def test_an_older_takeover_that_is_retained_is_replaced(
    world: World, address: BrokerAddress, tmp_path: Path
) -> None:
    south = StationAuthority(keys("south", "cleo", two_people(tmp_path)))
    south.take_command("cleo", KEYS["cleo"])
    retained: list[str] = []
    with running(world, address, rate=RATE), joined(world, address, south) as fleet:
        link = StationLink(address, "north", SIGNED)
        assert link.wait_connected(5.0)
        old = signed_messages(address.site, {"takeover": TO_NORTH}, Numbers(), SENT)
        assert link.publish(*old)
        while retained[-1:] != [south.newest["takeover"]] or TO_NORTH not in retained:
            fleet.step()
            link.wait_news(0.05)
            came = [delivery.message for delivery in link.take()]
            retained += [each.message for each in came if isinstance(each, SignedTakeover)]
        link.close()
    assert south.refusal == ""
