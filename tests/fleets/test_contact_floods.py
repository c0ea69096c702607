"""Contacts without end from one sensor: they hide none that another sensor sees."""

from collections.abc import Iterable
from datetime import UTC, datetime
from random import Random
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pa_console.fleets.reported_picture import (
    MOST_ALONE,
    MOST_CONTACTS,
    MOST_TRACKS,
    ReportedPicture,
    SetAside,
)
from pa_console.fleets.vda5050.additions import MANUFACTURER, Detections, SeenContact
from pa_console.fleets.vda5050.broker import BrokerAddress
from pa_console.resources import find_data
from pa_console.schema.events.event import Noticed
from pa_console.schema.mission import Alarm
from pa_console.schema.telemetry import Identity, Intent, Picture, Track
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.worlds.world_file import load_world
from pa_console.station.alarms.alarm_book import MOST_ALIKE
from pa_console.station.intake import MOST_FROM_ALARMS, Intake
from tests.fleets.conftest import overheard

WORLD = load_world(find_data("worlds", "checkpoint", "world.yaml"))
HOME = Checkpoint(WORLD, 1, None).picture().assets
PERIOD = round(WORLD.telemetry_period_s / WORLD.dt_s)
WITNESS, GATE = "NorthCamera", "NorthGate"
HONEST = SeenContact(
    signature="van", kind="vehicle", x=7.0, y=80.0, sigma_m=0.5, identity="unauthorized"
)
OTHERS = tuple(name for name in (*WORLD.assets, *WORLD.cameras) if name != WITNESS)


def seen(sensor: str, *contacts: SeenContact) -> Detections:
    return Detections(
        header_id=1, timestamp=datetime.now(UTC), version="3.0.0", manufacturer=MANUFACTURER,
        serial_number=sensor, contacts=contacts,
    )  # fmt: skip


def place_of(sensor: str) -> tuple[float, float]:
    return WORLD.cameras[sensor].at if sensor in WORLD.cameras else HOME[sensor].position


def phantom(random: Random, sensor: str, name: str, within_m: float = 40.0) -> SeenContact:
    """Return a contact of a sensor that lies, of any kind and anywhere around it."""
    x, y = place_of(sensor)
    return SeenContact(
        signature=name,
        kind=random.choice(("vehicle", "person")),
        x=x + random.uniform(-within_m, within_m),
        y=y + random.uniform(-within_m, within_m),
        sigma_m=random.choice((0.0, 1.0, 1e5)),
        identity=random.choice(get_args(Identity)),
        opinion=random.choice(get_args(Intent)),
        noncombatants=random.random() < 0.1,
        warned_s=random.choice((None, None, 0.0, 30.0)),
    )


class Desk:
    """A picture and the intake that looks at it, once a telemetry period."""

    def __init__(self) -> None:
        self.known = ReportedPicture(WORLD)
        self.intake = Intake(WORLD, "20260101T000000-abcd", respond=True)
        self.tick = 0
        self.aside: list[SetAside] = []

    def period(self, *detections: Detections) -> Picture:
        """Let everybody report, and the sensors of `detections` what they claim to see."""
        self.tick += PERIOD
        self.known.advance(self.tick)
        for name, said in HOME.items():
            stamped = said.model_copy(update={"stamp_s": self.tick * WORLD.dt_s})
            self.known.report(name, self.tick, stamped)
        for each in detections:
            self.aside += self.known.detect(self.tick, each.report())
        self.known.show()
        found = self.known.picture()
        self.intake.look(found, ())
        return found

    def alarms(self, tracks: Iterable[Track]) -> list[Alarm]:
        """Return the open alarms about `tracks`."""
        names = {track.id for track in tracks}
        return [alarm for alarm in self.intake.alarms.open if alarm.subject in names]


@given(
    liar=st.sampled_from(OTHERS),
    sizes=st.lists(st.sampled_from((0, 1, 9, 33, 70, 300)), min_size=6, max_size=10),
    fresh=st.booleans(),
    within_m=st.sampled_from((1.0, 40.0, 2000.0)),
    random=st.integers(0, 2**32).map(Random),
)
def test_beside_a_flood_an_honest_contact_is_a_track_with_its_alarm_and_mission(
    *, liar: str, sizes: list[int], fresh: bool, within_m: float, random: Random
) -> None:
    desk, tracks = Desk(), list[Track]()
    for number, size in enumerate((*sizes, 300, 300, 300)):
        names = [f"{number}-{each}" if fresh else str(each) for each in range(size)]
        claimed = [phantom(random, liar, name, within_m) for name in names]
        found = desk.period(seen(liar, *claimed), seen(WITNESS, HONEST))
        tracks = list(found.tracks.values())
        alone = [track for track in tracks if WITNESS not in track.seen_by]
        assert len(tracks) == len(alone) + 1
        assert len(alone) <= MOST_ALONE
        urgent = [a for a in desk.alarms(alone) if a.priority in ("emergency", "high")]
        for kind in {alarm.kind for alarm in urgent}:
            assert sum(alarm.kind == kind for alarm in urgent) <= MOST_ALIKE
        assert len(desk.intake.queue.missions) <= MOST_FROM_ALARMS
    (honest,) = (track for track in tracks if WITNESS in track.seen_by)
    (alarm,) = desk.alarms([honest])
    assert (alarm.priority, alarm.gate) == ("high", GATE)
    waiting = [desk.intake.queue.pop_next() for _ in range(len(desk.intake.queue.missions))]
    assert alarm.id in [mission.alarm for mission in waiting if mission is not None]
    assert {each.sensor for each in desk.aside} <= {liar}


@given(
    liars=st.lists(st.sampled_from(OTHERS), min_size=4, max_size=8, unique=True),
    together=st.booleans(),
    random=st.integers(0, 2**32).map(Random),
)
def test_however_many_sensors_lie_an_honest_contact_gets_in(
    *, liars: list[str], together: bool, random: Random
) -> None:
    """Together they report the same contacts, so that each is confirmed by the others."""
    desk = Desk()
    claims = [
        seen(
            liar,
            *(
                phantom(random, liar, str(n) if together else f"{liar}-{n}", within_m=5.0)
                for n in range(start, start + MOST_CONTACTS)
            ),
        )
        for start in range(0, MOST_TRACKS, MOST_CONTACTS)
        for liar in liars
    ]
    for _ in range(3):
        assert len(desk.period(*claims).tracks) <= MOST_TRACKS
    found = desk.period(*claims, seen(WITNESS, HONEST))
    assert len(found.tracks) <= MOST_TRACKS
    assert any(WITNESS in track.seen_by for track in found.tracks.values())


def test_a_flood_is_one_alarm_that_names_the_sensor_and_how_many() -> None:
    desk = Desk()
    x, y = place_of("Drone_T03")
    flood = [
        HONEST.model_copy(update={"signature": str(n), "x": x + n % 30, "y": y}) for n in range(900)
    ]
    found = desk.period(seen("Drone_T03", *flood))
    for _ in range(6):
        found = desk.period(seen("Drone_T03", *flood))
    assert len(found.tracks) == MOST_ALONE
    text = f"reports 900 contacts: {MOST_ALONE} are accepted, the rest is set aside"
    assert ("Drone_T03", text) in {(each.sensor, each.text) for each in desk.aside}
    (summary,) = (alarm for alarm in desk.intake.alarms.open if alarm.kind == "many_contacts")
    assert (summary.subject, summary.priority, summary.command) == ("Drone_T03", "high", "")
    assert summary.text.startswith(f"Drone_T03 alone reports {MOST_ALONE} contacts")
    assert len(desk.alarms(found.tracks.values())) == MOST_ALIKE
    for _ in range(60):
        desk.period()
    assert not [a for a in desk.intake.alarms.open if a.kind == "many_contacts"]


@pytest.mark.parametrize("sensor", ["Drone_T03", "EastCamera"])
def test_a_contact_beyond_the_range_of_its_sensor_is_no_track(sensor: str) -> None:
    spec = WORLD.cameras.get(sensor) or WORLD.platforms[WORLD.assets[sensor].kind]
    x, y = place_of(sensor)
    for away_m, sigma_m, taken in (
        (spec.sensor_range_m, 0.5, True),
        (2 * spec.sensor_range_m, 0.5, False),
        (2 * spec.sensor_range_m, 1e5, False),
    ):
        desk = Desk()
        desk.period()
        at = {"x": x + away_m, "y": y, "sigma_m": sigma_m}
        found = desk.period(seen(sensor, HONEST.model_copy(update=at)))
        assert bool(found.tracks) == taken
        assert [each.sensor for each in desk.aside] == [sensor] * (not taken)
        assert all("beyond its range" in each.text for each in desk.aside)


def test_a_sensor_whose_place_is_not_known_opens_no_track() -> None:
    known = ReportedPicture(WORLD)
    x, y = place_of("Drone_T03")
    contact = HONEST.model_copy(update={"x": x, "y": y})
    (aside,) = known.detect(0, seen("Drone_T03", contact).report())
    known.show()
    assert (known.picture().tracks, aside.sensor) == ({}, "Drone_T03")


def test_a_message_of_900_contacts_on_the_bus_is_told_in_one_line(
    world: World, address: BrokerAddress
) -> None:
    with overheard(world, address) as (evil, fleet):
        for _ in range(20):
            fleet.step()
        x, y = fleet.picture().assets["Drone_T03"].position
        crowd = [
            HONEST.model_copy(update={"signature": str(n), "x": x, "y": y}) for n in range(900)
        ]
        message = seen("Drone_T03", *crowd).model_copy(update={"timestamp": fleet.now()})
        evil.send(evil.topic("Drone_T03", "detections"), message.write())
        lines = [line for _ in range(20) for line in fleet.step().told if isinstance(line, Noticed)]
        assert [line.subject for line in lines if "contacts" in line.text] == ["Drone_T03"]
        assert 0 < len(fleet.picture().tracks) <= MOST_ALONE
