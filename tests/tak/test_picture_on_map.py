"""What a map is told of a picture: what is stale never looks fresh, and what is gone is removed."""

import math
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime, timedelta
from xml.etree.ElementTree import Element, fromstring

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from pa_console.schema.events.event import Event, SessionEnded, TelemetryReceived
from pa_console.schema.incident import SetComms, SpawnTrack
from pa_console.schema.telemetry import Identity, Intent, Picture, Track
from pa_console.schema.world import Origin
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.worlds.geography import Geography
from pa_console.tak.cot_event import DELETE, CotEvent, element
from pa_console.tak.session_on_map import (
    DRAWN_S,
    SHAPE,
    PictureOnMap,
    SessionOnMap,
    SiteOnMap,
    affiliation,
    track_type,
)
from tests.sim.running import order, run

START = datetime(2026, 1, 1, tzinfo=UTC)
ROUNDED = timedelta(microseconds=2)
"""What sums of seconds and moments may differ by."""


def at(picture: Picture) -> datetime:
    """The moment of a picture, when a second of the world is one of the map."""
    return START + timedelta(seconds=picture.time_s)


def about(events: Sequence[CotEvent], uid: str) -> list[CotEvent]:
    return [event for event in events if event.subject == uid]


def details(event: CotEvent) -> dict[str, Element]:
    return {each.tag: each for each in fromstring(event.xml()).find("detail") or ()}


def test_an_asset_is_told_with_all_that_is_known_of_it(site: SiteOnMap) -> None:
    sim = Checkpoint(site.world, seed=1)
    order(sim, "Ugv_T02", "move_to", "EastGate")
    run(sim, 3.0)
    picture = sim.picture()
    asset = picture.assets["Ugv_T02"]
    told = PictureOnMap(site).events(picture, at(picture))
    [event] = about(told, "pa-console.sea.Ugv_T02")
    assert (event.type, event.how) == ("a-f-G-E-V-U", "m-g")
    assert event.stale - event.time == timedelta(seconds=site.world.stale_s)
    assert event.time == START + timedelta(seconds=asset.stamp_s)
    assert event.point.hae == 12.0
    told_of = details(event)
    assert told_of["contact"].get("callsign") == "Ugv_T02"
    assert told_of["status"].get("battery") == f"{asset.battery_pct:.0f}"
    assert float(told_of["track"].get("speed") or 0) == pytest.approx(asset.speed_mps, abs=0.01)
    assert "vehicle, moving, posted to EastGate" in (told_of["remarks"].text or "")
    [route] = about(told, "pa-console.sea.route.Ugv_T02")
    assert (route.type, route.stale) == (SHAPE, event.stale)
    links = (fromstring(route.xml()).find("detail") or Element("none")).findall("link")
    assert len(links) == len(asset.route) + 1
    kinds = {event.uid.rsplit(".", 1)[-1]: event.type for event in told}
    assert (kinds["Drone_T01"], kinds["Robot_T01"]) == ("a-f-A-M-H-Q", "a-f-G-E-V")
    [drone] = about(told, "pa-console.sea.Drone_T01")
    assert drone.point.hae > 1e6, "nobody knows how high a drone flies"


def test_whoever_falls_silent_is_told_once_stale_and_fresh_when_heard_again(
    site: SiteOnMap,
) -> None:
    sim, shown = Checkpoint(site.world, seed=1), PictureOnMap(site)
    order(sim, "Robot_T01", "move_to", "WestGate")
    run(sim, 2.0)
    silent = "pa-console.sea.Robot_T01"
    route = "pa-console.sea.route.Robot_T01"
    assert about(shown.events(sim.picture(), at(sim.picture())), route)
    sim.inject(SetComms(asset="Robot_T01", comms="lost"))
    last: list[CotEvent] = []
    removed: list[CotEvent] = []
    for _ in range(20):
        run(sim, 0.5)
        now = at(sim.picture())
        told = shown.events(sim.picture(), now)
        last += about(told, silent)
        removed += [event for event in about(told, route) if event.type == DELETE]
        fresh = [event for event in about(told, silent) if event.stale > now]
        assert not (fresh and sim.picture().assets["Robot_T01"].stale)
    assert "no report for" in (details(last[-1])["remarks"].text or "")
    assert last[-1].stale <= START + timedelta(seconds=sim.picture().time_s)
    assert last[-1].stale - last[-1].time <= timedelta(seconds=site.world.stale_s)
    assert ["no report" in (details(e)["remarks"].text or "") for e in last].count(True) == 1
    assert len(removed) == 1, "nobody knows where it is going now"
    sim.inject(SetComms(asset="Robot_T01", comms="ok"))
    run(sim, 1.5)
    now = at(sim.picture())
    [event] = about(shown.events(sim.picture(), now), silent)
    assert event.stale > now


def test_a_track_that_is_gone_is_removed(site: SiteOnMap) -> None:
    sim, shown = Checkpoint(site.world, seed=1), PictureOnMap(site)
    sim.inject(SpawnTrack(gate="WestGate", distance_m=60.0))
    run(sim, 4.0)
    picture = sim.picture()
    [(name, track)] = picture.tracks.items()
    uid = f"pa-console.sea.track.{name}"
    [event] = about(shown.events(picture, at(picture)), uid)
    assert event.type == track_type(track)
    assert event.point.ce == pytest.approx(track.uncertainty_m)
    without = picture.model_copy(update={"tracks": {}})
    [gone] = about(shown.events(without, at(picture)), uid)
    assert gone.type == DELETE
    [link] = [each for each in gone.detail if each.tag == "link"]
    assert link.get("uid") == uid
    assert not about(shown.events(without, at(picture)), uid), "it is removed once"


@given(
    st.sampled_from(("unknown", "authorized", "unauthorized")),
    st.sampled_from(("unknown", "benign", "hostile")),
    st.booleans(),
)
def test_nothing_is_ever_hostile_on_the_map_and_only_the_authorized_are_friends(
    identity: Identity, intent: Intent, noncombatants: bool
) -> None:
    track = Track(
        id="T",
        kind="vehicle",
        gate="WestGate",
        position=(0.0, 0.0),
        heading_deg=0.0,
        speed_mps=0.0,
        distance_m=0.0,
        stamp_s=0.0,
        identity=identity,
        intent=intent,
        noncombatants=noncombatants,
    )
    found = affiliation(track)
    assert track_type(track) == f"a-{found}-G-E-V"
    assert found != "f" or (identity == "authorized" and intent != "hostile")
    assert found == "s" or intent != "hostile"
    assert found in ("s", "n") or identity != "unauthorized"


steps = st.lists(
    st.tuples(st.floats(0.1, 5.0), st.booleans(), st.floats(0.0, 20.0), st.booleans()), max_size=12
)


@given(steps)
def test_no_history_of_reports_makes_anything_look_fresher_than_it_is(
    site: SiteOnMap, first: Picture, history: list[tuple[float, bool, float, bool]]
) -> None:
    shown, now_s, stale_s = PictureOnMap(site), first.time_s, site.world.stale_s
    stamp_s = now_s
    for passed_s, heard, late_s, doubted in history:
        now_s += passed_s
        stamp_s = max(stamp_s, now_s - late_s) if heard else stamp_s
        asset = first.assets["Drone_T01"].model_copy(
            update={"stamp_s": stamp_s, "stale": doubted, "route": ((1.0, 1.0),)}
        )
        picture = first.model_copy(update={"time_s": now_s, "assets": {asset.id: asset}})
        now = START + timedelta(seconds=now_s)
        reported = START + timedelta(seconds=stamp_s)
        for event in shown.events(picture, now):
            assert event.stale <= max(reported + timedelta(seconds=stale_s), now) + ROUNDED
            fresh = event.stale > now
            assert not fresh or (
                not doubted and now - reported < timedelta(seconds=stale_s) + ROUNDED
            )


class Kept:
    """Keeps what is sent."""

    def __init__(self) -> None:
        self.connections = 1
        self.told: list[CotEvent] = []

    def send(self, events: Iterable[CotEvent]) -> None:
        """Keep `events`."""
        self.told += events

    def take(self) -> list[CotEvent]:
        """Return what was sent since the last call."""
        taken, self.told = self.told, []
        return taken


def test_the_ground_is_drawn_once_a_connection_and_is_gone_with_the_session(
    site: SiteOnMap, first: Picture
) -> None:
    kept, now = Kept(), START
    shown = SessionOnMap(site, kept, every_s=1.0, now=lambda: now)

    def told(seconds: float) -> set[str]:
        nonlocal now
        now += timedelta(seconds=seconds)
        shown.take(Event(t=now, tick=0, data=TelemetryReceived(picture=first)))
        return {event.uid.removeprefix("pa-console.sea.") for event in kept.take()}

    ground = {"perimeter", "zone.Depot", "frame.NorthGate", "frame.Base"}
    assert ground <= told(0.0)
    assert not told(0.5), "one picture a second is enough"
    assert "Drone_T01" in (again := told(1.0))
    assert not ground & again
    kept.connections += 1
    assert ground <= told(1.0)
    assert ground <= told(DRAWN_S / 2), "drawn anew before it goes stale"
    shown.take(Event(t=now, tick=0, data=SessionEnded(reason="over")))
    assert {e.subject.removeprefix("pa-console.sea.") for e in kept.told if e.type == DELETE} > (
        ground
    )


def test_a_clock_that_goes_ahead_makes_nothing_fresher(site: SiteOnMap, first: Picture) -> None:
    kept = Kept()
    shown = SessionOnMap(site, kept, now=lambda: START)
    ahead = START + timedelta(hours=1)
    shown.take(Event(t=ahead, tick=0, data=TelemetryReceived(picture=first)))
    assets = [event for event in kept.told if event.uid.endswith("Drone_T01")]
    assert assets
    assert all(event.stale <= START + timedelta(seconds=3) for event in assets)


def test_what_xml_and_terminals_cannot_take_is_escaped() -> None:
    event = CotEvent(
        "u", "a-u-G", START, START, detail=(element("remarks", {}, "a\x1b[2J<b>&\x00"),)
    )
    remarks = details(event)["remarks"].text
    assert remarks == r"a\x1b[2J<b>&\x00"


@pytest.fixture(scope="module")
def first(site: SiteOnMap) -> Picture:
    """A picture in which everybody has reported."""
    sim = Checkpoint(site.world, seed=1)
    run(sim, 2.0)
    return sim.picture()


CENTIMETRE = 0.01
SEMI_MAJOR_M, FLATTENING = 6_378_137.0, 1 / 298.257223563
"""The ellipsoid of WGS-84."""


def metres(most: float) -> st.SearchStrategy[float]:
    return st.floats(-most, most)


origins = st.builds(
    Origin,
    latitude=st.floats(-89.0, 89.0),
    longitude=st.floats(-180.0, 180.0),
    bearing=st.floats(0.0, 359.0),
    altitude=st.none() | st.floats(-400.0, 8000.0),
)


@given(origins, metres(1000.0), metres(1000.0))
def test_there_and_back_is_the_same_place(origin: Origin, x: float, y: float) -> None:
    geography = Geography(origin)
    back = geography.metres(*geography.degrees((x, y)))
    assert math.dist(back, (x, y)) < CENTIMETRE


@given(st.floats(-45.0, 45.0), st.floats(-179.0, 179.0), metres(120.0), metres(120.0))
def test_a_degree_is_as_long_as_the_ellipsoid_says(
    latitude: float, longitude: float, x: float, y: float
) -> None:
    found = Geography(Origin(latitude=latitude, longitude=longitude)).degrees((x, y))
    squared = FLATTENING * (2 - FLATTENING)
    bulge = 1 - squared * math.sin(math.radians(latitude)) ** 2
    across, along = SEMI_MAJOR_M / bulge**0.5, SEMI_MAJOR_M * (1 - squared) / bulge**1.5
    north = math.radians(found[0] - latitude) * along
    east = math.radians(found[1] - longitude) * across * math.cos(math.radians(latitude))
    assert math.dist((east, north), (x, y)) < CENTIMETRE


@pytest.mark.parametrize(
    ("bearing", "north", "east"), [(0.0, 1, 0), (90.0, 0, 1), (180.0, -1, 0), (270.0, 0, -1)]
)
def test_the_bearing_turns_the_world(bearing: float, north: int, east: int) -> None:
    origin = Origin(latitude=2.0, longitude=-30.0, bearing=bearing)
    latitude, longitude = Geography(origin).degrees((0.0, 100.0))
    assert (round((latitude - 2.0) / 0.0009), round((longitude + 30.0) / 0.0009)) == (north, east)
    assert Geography(origin).course(90.0) == bearing, "the y axis points where the bearing says"
    assert Geography(origin).course(0.0) == (bearing + 90.0) % 360.0


@pytest.mark.parametrize(
    ("field", "value"),
    [("latitude", 90.1), ("longitude", -181.0), ("bearing", 360.0), ("altitude", 1e5)],
)
def test_an_origin_that_is_nowhere_is_refused(field: str, value: float) -> None:
    with pytest.raises(ValidationError, match=field):
        Origin(**{"latitude": 0.0, "longitude": 0.0} | {field: value})
