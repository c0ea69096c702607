"""`--fleet` given several times: robots on a bus and on links are one team with one STOP."""

import time
from datetime import UTC, datetime
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from pa_console.cli.sessions.fleet import find_fleet
from pa_console.fleets import link as links
from pa_console.fleets.link import GROUP
from pa_console.fleets.linked_fleet import LinkedFleet
from pa_console.fleets.station_authority import Keys, StationAuthority
from pa_console.fleets.vda5050.broker import BrokerAddress
from pa_console.mission.gate import CommandGate
from pa_console.mission.stop import EmergencyStop
from pa_console.schema.command import DeviceCommand, Verb
from pa_console.schema.events import event as ev
from pa_console.schema.world import AssetSpec, World
from pa_console.session.log.journal import Journal
from pa_console.settings.schema import Settings
from pa_console.station.assembly import load_site
from pa_console.station.clock import DevicesClock, SteppedClock
from tests.fleets.conftest import joined, running
from tests.fleets.keyring import KEYS, PUBLIC, TO_SOUTH
from tests.fleets.scripted_link import Desk, ScriptedLink
from tests.mission.test_two_people import BOOK, MESSAGES, decision_on, request

ON_BUS, ON_LINK = "Drone_T01", "Drone_T09"
OPENED: list[ScriptedLink] = []


def open_scripted(address: str, world: World, settings: Settings) -> ScriptedLink:
    """Return a link to the assets that the address names."""
    if not address:
        raise ValueError("own: names no asset: own:Drone_T01")
    OPENED.append(ScriptedLink(f"own:{address}", address.split(",")))
    return OPENED[-1]


@pytest.fixture(autouse=True)
def own_scheme(monkeypatch: pytest.MonkeyPatch) -> None:
    OPENED.clear()
    point = EntryPoint("own", f"{__name__}:open_scripted", GROUP)
    monkeypatch.setattr(links, "link_schemes", lambda: {"own": point})


def found(*urls: str, certificates: Path | None = None, scenario: str | None = None) -> object:
    return find_fleet(urls, certificates, "checkpoint", Settings(), scenario)


def test_two_links_are_one_fleet_in_the_time_of_its_robots() -> None:
    site = load_site("checkpoint", "checkpoint")
    one = find_fleet(["own:Drone_T01", "own:Ugv_T01"], None, "checkpoint", Settings(), None)
    assert isinstance(one.clock(SteppedClock()), DevicesClock)
    for link in OPENED:  # nobody waits for a link that does not work
        link.problem = "cut"
    fleet, bus = one.drive(site, None)
    assert bus is None
    assert isinstance(fleet, LinkedFleet)
    assert fleet.picture().links == {"Drone_T01": "own:Drone_T01", "Ugv_T01": "own:Ugv_T01"}
    fleet.close()
    assert [link.closed for link in OPENED] == [True, True]


def test_an_asset_on_two_links_ends_the_start_and_leaves_no_link_open() -> None:
    site = load_site("checkpoint", "checkpoint")
    one = find_fleet(
        ["own:Drone_T01", "own:Ugv_T01,Drone_T01"], None, "checkpoint", Settings(), None
    )
    with pytest.raises(ValueError, match="Drone_T01 is on two links"):
        one.drive(site, None)
    assert [link.closed for link in OPENED] == [True, True]


def test_a_link_that_cannot_be_opened_closes_those_before_it() -> None:
    with pytest.raises(ValueError, match="names no asset"):
        found("own:Drone_T01", "own:")
    assert [link.closed for link in OPENED] == [True]


@pytest.mark.parametrize(
    ("urls", "more", "why"),
    [
        (("mqtts://a/x", "mqtts://b/y"), {}, "at most one message bus"),
        (("own:Drone_T01",), {"scenario": "situation-2"}, "cannot be combined with --fleet"),
        (("own:Drone_T01",), {"certificates": Path("keys")}, "--certificates needs a message bus"),
        (("other:1",), {}, "there is no link 'other'"),
    ],
)
def test_what_does_not_go_together_is_said_before_anything_is_opened(
    urls: tuple[str, ...], more: dict[str, object], why: str
) -> None:
    with pytest.raises(ValueError, match=why):
        found(*urls, **more)  # pyright: ignore[reportArgumentType]
    assert not OPENED


def test_with_keys_only_what_people_approved_goes_to_a_link_while_the_station_commands() -> None:
    site = load_site("checkpoint", "checkpoint")
    keys = Keys(KEYS["north"], "ann", KEYS["ann"], PUBLIC["owner"], MESSAGES)
    authority = StationAuthority(keys, site.world.assets)
    authority.begin("S", lambda: "head", time.time)
    one = find_fleet(["own:Ugv_T01"], None, "checkpoint", Settings(), None)
    (link,) = OPENED
    link.news.append(Desk(site.world).report("Ugv_T01", "Base", sent=datetime.now(UTC)))
    fleet, _ = one.drive(site, authority)
    assert fleet is not None
    asked = request(1, "move")
    authority.grant(asked, authority.signed(asked, decision_on(asked), BOOK), BOOK)

    def answers(number: int, verb: Verb, target: str | None = None) -> list[str]:
        fleet.send(
            DeviceCommand(command_id=f"M1.{number}", agent="Ugv_T01", verb=verb, target=target)
        )
        return [reply.detail for reply in fleet.step().replies]

    link.problem = "cut"
    assert answers(1, "move_to", "EastGate") == []
    assert not link.sent
    link.problem = ""
    assert answers(1, "move_to", "EastGate") == []
    assert answers(2, "move_to", "WestGate") == ["it has no authorization"]
    assert authority.take(TO_SOUTH) == ""
    assert "it has no authorization" in answers(3, "return_to_base")
    assert answers(4, "hold") == []
    assert [(c.verb, c.target) for c in link.sent] == [("move_to", "EastGate"), ("hold", None)]


def test_one_picture_and_one_stop_for_a_bus_and_a_link(
    world: World, address: BrokerAddress
) -> None:
    drone = AssetSpec(kind="uav", post="Base")
    larger = world.model_copy(update={"assets": {**world.assets, ON_LINK: drone}})
    link = ScriptedLink("air:1", {ON_LINK})
    with running(world, address, paced=True) as site, joined(larger, address) as bus:
        fleet = LinkedFleet(larger, [link], bus, now=bus.now)
        desk = Desk(larger)
        stops = EmergencyStop(fleet, CommandGate(fleet, Journal()))
        doubts: list[dict[str, str]] = []

        def go(steps: int) -> None:
            for _ in range(steps):
                link.news.append(desk.report(ON_LINK, "EastGate", sent=bus.now()))
                received = fleet.step()
                events = stops.step((fleet.tick, received.replies))
                doubts.extend(dict(e.assets) for e in events if isinstance(e, ev.StopUnconfirmed))

        go(10)
        assets = fleet.picture().assets
        assert assets[ON_LINK].at == "EastGate"
        assert assets[ON_LINK].available
        assert assets[ON_BUS].available
        assert fleet.picture().links[ON_LINK] == "air:1"
        assert fleet.picture().links[ON_BUS] == str(address)
        go_north = DeviceCommand(command_id="M1.1", agent=ON_BUS, verb="move_to", target="EastGate")
        fleet.send(go_north)
        fleet.send(go_north.model_copy(update={"command_id": "M1.2", "agent": ON_LINK}))
        go(10)
        assert site.site.checkpoint.truth().assets[ON_BUS].speed_mps > 0.0
        assert [c.agent for c in link.sent] == [ON_LINK]
        stops.hold_all()
        assert link.sent[-1].verb == "hold"
        go(40)
        assert site.site.checkpoint.truth().assets[ON_BUS].speed_mps == 0.0
        assert stops.waiting, "the link has not answered"
        assert set(doubts[-1]) == {ON_LINK}
        link.answer("done")
        go(10)
        assert not stops.waiting


def test_a_robot_on_the_bus_that_is_on_a_link_as_well_is_an_error(
    world: World, address: BrokerAddress
) -> None:
    with (
        running(world, address, paced=True),
        joined(world, address) as bus,
        pytest.raises(ValueError, match=f"{ON_BUS} is on two links, {address} and air:1"),
    ):
        LinkedFleet(world, [ScriptedLink("air:1", {ON_BUS})], bus)
