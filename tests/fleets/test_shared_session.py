"""A second person countersigns over the bus what the rules want two people for."""

import asyncio
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from pa_console.fleets import authorization as auth
from pa_console.fleets.station_authority import Keys, StationAuthority, Vehicles
from pa_console.fleets.vda5050.additions import StopAsked
from pa_console.fleets.vda5050.broker import BrokerAddress
from pa_console.fleets.vda5050.sharing import SharedSession
from pa_console.fleets.vda5050.station_link import StationLink
from pa_console.fleets.vda5050.wire import Header
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Decision
from pa_console.schema.world import World
from pa_console.session.log.writer import LogWriter
from pa_console.session.state import SessionState
from pa_console.station.assembly import Site, load_site, open_station
from pa_console.station.clock import DevicesClock
from pa_console.station.joined.joined_station import JoinedStation, Signatory
from pa_console.station.joined.shared_log import HEARD, SharedLog, read_so_far
from pa_console.station.station import ControlStation
from tests.fleets.conftest import joined, running
from tests.fleets.keyring import KEYS, PUBLIC, ROSTER, TO_NORTH
from tests.scripted import ScriptedEngine, plan

RATE = 8.0
LIMIT_S = 120.0


def patient(world: World) -> World:
    """Return `world` with RATE times the patience for assets that are silent.

    On a site that runs RATE times faster, a process that waits half a second for a processor would
    count as an asset that is lost, and end a mission.
    """
    update = {"stale_s": RATE * world.stale_s, "link_lost_s": RATE * world.link_lost_s}
    return world.model_copy(update=update)


@pytest.fixture(scope="module", name="world")
def patient_world(world: World) -> World:
    """The world of the folder, with patience."""
    return patient(world)


def messages(site: Site) -> tuple[str, ...]:
    """What everybody goes by: `block` takes two people."""
    rules = {site.rulebook.seal.content_sha256: auth.EnrolledRules("two", {"block": 2})}
    roster = auth.Roster(2, ROSTER.people, ROSTER.stations, rules)
    return auth.sign_roster(KEYS["owner"], roster), TO_NORTH


def two_people(tmp_path: Path) -> Site:
    """The shipped rules, with two people for `block`."""
    found = load_site("checkpoint", "checkpoint")
    text = found.rules_path.read_text("utf-8")  # pyright: ignore[reportOptionalMemberAccess]
    file = tmp_path / "two.yaml"
    file.write_text(text.replace("rules:\n", "approvals: {block: 2}\nrules:\n", 1), "utf-8")
    return load_site("checkpoint", str(file), unsigned=True)


def join(address: BrokerAddress, person: str, site: Site) -> JoinedStation:
    """A console that has joined, at which `person` sits; it has learnt the roster from the bus."""
    log = SharedLog(StationLink(address, person, HEARD), auth.Trust(PUBLIC["owner"]), len)
    before = read_so_far(log, lambda _done, _total: None)
    signatory = Signatory(person, KEYS[person])
    return JoinedStation(log, before, signatory, site.world, site.rulebook)


async def until(done: Callable[[], object]) -> None:
    end = time.monotonic() + LIMIT_S
    while not done():
        assert time.monotonic() < end, "it did not come to that"
        await asyncio.sleep(0.02)


class Watched:
    """Folds what a station yields."""

    def __init__(self, station: ControlStation | JoinedStation) -> None:
        self.state = SessionState()
        self.events: list[ev.Event] = []
        self._station = station
        self.task = asyncio.create_task(self._run())

    async def _run(self) -> None:
        async for event in self._station.run():
            self.events.append(event)
            self.state.apply(event)

    @property
    def request(self) -> ev.ApprovalRequested | None:
        """The plan that waits."""
        return self.state.current.approval if self.state.current is not None else None

    def notices(self) -> str:
        """What was reported, line by line."""
        return "\n".join(each.text for each in self.state.notices)

    @property
    def signers(self) -> set[str]:
        """Who has signed the current mission's plan."""
        made = self.state.current.decisions if self.state.current is not None else []
        return {name for each in made for name in each.decision.signatures}


def lose_stops(monkeypatch: pytest.MonkeyPatch, console: JoinedStation, count: int) -> None:
    """Let the first `count` stops that a console asks for get lost on the way."""
    log, left = console._log, [count]  # pyright: ignore[reportPrivateUsage]
    publish = log.publish

    def lossy(message: Header, expiry_s: int | None = None) -> bool:
        if isinstance(message, StopAsked) and left[0] > 0:
            left[0] -= 1
            return True
        return publish(message, expiry_s)

    monkeypatch.setattr(log, "publish", lossy)


async def ask(joined: JoinedStation, watched: Watched) -> None:
    """Ask about another vehicle, which anybody may, and wait until it is shown there."""
    question = joined.question_in("Why not Ugv_T01?")
    assert question is not None
    told = await joined.answer(question)
    await until(lambda: watched.state.current and told in watched.state.current.answers)
    assert {line.about for line in told.lines} == {"Ugv_T01"}


async def stop_from(console: JoinedStation, watched: Watched, station: Watched) -> None:
    """Press STOP at a joined console; it asks until the station has stopped, and says so."""
    console.stop_all()
    await until(lambda: station.state.stop and watched.state.stop)
    await until(lambda: "STOP not confirmed by north" in watched.notices())
    await until(lambda: "north has stopped" in watched.notices())
    (stop,) = [each.data for each in station.events if isinstance(each.data, ev.AllStopped)]
    assert stop.by == "otto at another station"


async def test_a_block_is_carried_out_once_both_have_signed(
    world: World, address: BrokerAddress, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    site = two_people(tmp_path)
    told = messages(site)
    vehicles = Vehicles(world.assets, PUBLIC["owner"], (), time.time)
    keys = Keys(KEYS["north"], "ann", KEYS["ann"], PUBLIC["owner"], told)
    authority = StationAuthority(keys)
    engine = ScriptedEngine([plan(("Ugv_T02", "block EastGate"))]).engine()
    with (
        running(world, address, rate=RATE, verify=vehicles.verify, take=vehicles.take),
        joined(world, address, authority) as fleet,
    ):
        station = open_station(
            site, engine, DevicesClock(RATE), fleet=fleet, authority=authority, read_unasked=False
        )
        log = LogWriter(tmp_path / "log.jsonl", station.session)
        shared = SharedSession(station.session, authority.name, log.path, authority.vouch)
        log.on_record = shared.add
        fleet.share(shared)
        station.write_to(log)
        ann = Watched(station)
        await until(lambda: ann.state.picture)
        bob, otto = [await asyncio.to_thread(join, address, name, site) for name in ("bob", "otto")]
        second, third = Watched(bob), Watched(otto)
        station.submit("Block the east gate with Ugv_T02.")
        await until(lambda: ann.request and second.request and third.request)
        assert second.request == ann.request
        assert ann.request is not None
        approve = Decision(kind="approve", reason="seen", acknowledged=ann.request.acknowledge)
        assert (bob.station, bob.signer, otto.signer) == ("north", "bob", "")
        for console, decision in ((otto, approve), (bob, Decision(kind="reject"))):
            with suppress(ValueError):
                console.decide(decision)
                raise AssertionError("an observer signs nothing, and a second person only that")
        bob.decide(approve)
        await until(lambda: ann.signers == {"bob"} == second.signers)
        bob.decide(approve)
        station.decide(approve)
        await until(lambda: second.state.current and second.state.current.status)
        mission = ann.state.current
        assert mission is not None
        assert mission.status == "verified", mission
        assert ann.signers == {"ann", "bob"} == second.signers == third.signers
        await ask(otto, third)
        lose_stops(monkeypatch, otto, 3)
        await stop_from(otto, third, ann)
        await station.close()
        await until(lambda: second.state.ended and third.state.ended)
        await asyncio.gather(ann.task, second.task, third.task)
        log.close()
        told = {event.data.kind for each in (ann, second) for event in each.events}
        assert "question_answered" not in told
    seen = [event for event in second.events if event.data.kind not in ("telemetry", "noticed")]
    logged = [e for e in ann.events if e.data.kind not in ("telemetry", "noticed")]
    assert seen == [event for event in logged if not event.data.transient]
