"""Who a contact is: what sensors say of it, weighed, disputed, withdrawn, or not counted."""

from dataclasses import dataclass
from typing import Literal, get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.schema.base import Point
from pa_console.schema.telemetry import Identity, Intent, Track
from pa_console.schema.world import World
from pa_console.sim.scene import Scene
from pa_console.sim.sensing import tracker
from pa_console.sim.sensing.evidence import FORGOTTEN_S, WITHDRAWN_S
from pa_console.sim.sensing_state import Detection
from pa_console.sim.worlds.terrain import Terrain
from tests.sim.lookout import RANGE_M, lookout, reports_from, scene_at

WAITS: Point = (0.0, 9.0)
GATE: Point = (0.0, -6.0)
FAR: Point = (0.0, WAITS[1] + 2 * RANGE_M)
ROBOTS = ("Fox", "Wolf", "Lynx")
SENSORS = ("Cam", "Eagle", *ROBOTS)


@pytest.fixture
def terrain() -> Terrain:
    return Terrain(guarded())


def guarded() -> World:
    """Return a world with a camera, a UAV and three ground robots."""
    robots = {name: {"kind": "robot", "post": "Home"} for name in ROBOTS}
    return lookout(cameras={"Cam": {}}, assets={"Eagle": {"kind": "uav", "post": "Home"}, **robots})


@pytest.fixture
def scene() -> Scene:
    return scene_at()


def tell(
    terrain: Terrain,
    scene: Scene,
    sensor: str,
    *,
    at: Point | None = WAITS,
    stands: Point = GATE,
    identity: Identity = "unknown",
    opinion: Intent = "unknown",
    noncombatants: bool = False,
) -> Track:
    """Let a sensor that stands at `stands` report a contact now; return the only track."""
    reports_from(terrain, scene, sensor, stands)
    seen = Detection("X", "person", at, 0.5, identity, opinion, noncombatants)
    tracker.receive(terrain, scene, sensor, scene.tick, (seen,))
    [track] = tracker.tracks_known(terrain, scene).values()
    return track


def later(terrain: Terrain, scene: Scene, seconds: float) -> None:
    scene.tick += round(seconds / terrain.world.dt_s)


def test_a_robot_that_claims_no_position_identifies_nobody(terrain: Terrain, scene: Scene) -> None:
    tell(terrain, scene, "Cam", opinion="hostile", noncombatants=True)
    tell(terrain, scene, "Eagle", opinion="hostile")
    track = tell(terrain, scene, "Fox", at=None, identity="authorized", opinion="benign")
    assert (track.identity, track.intent) == ("unknown", "hostile")
    calm = scene_at()
    tell(terrain, calm, "Cam")
    track = tell(terrain, calm, "Fox", at=None, identity="authorized", opinion="benign")
    assert (track.identity, track.intent) == ("unknown", "unknown")


@pytest.mark.parametrize(("claimed", "stands"), [(WAITS, FAR), (FAR, FAR), (FAR, GATE)])
def test_a_robot_out_of_range_of_the_track_identifies_nobody(
    terrain: Terrain, scene: Scene, claimed: Point, stands: Point
) -> None:
    tell(terrain, scene, "Cam")
    track = tell(terrain, scene, "Fox", at=claimed, stands=stands, identity="authorized")
    assert track.identity == "unknown"
    assert tell(terrain, scene, "Fox", identity="authorized").identity == "authorized"


def test_a_sensor_that_lies_about_places_silences_no_other(terrain: Terrain, scene: Scene) -> None:
    tell(terrain, scene, "Cam", at=FAR)
    assert tell(terrain, scene, "Fox", identity="unauthorized").identity == "unauthorized"
    assert tell(terrain, scene, "Eagle", opinion="hostile").hostile_by == ("Eagle",)


def test_an_asset_that_has_not_said_where_it_is_identifies_nobody(
    terrain: Terrain, scene: Scene
) -> None:
    tell(terrain, scene, "Fox")
    later(terrain, scene, terrain.world.stale_s + 1.0)
    seen = Detection("X", "person", WAITS, 0.5, "authorized")
    tracker.receive(terrain, scene, "Fox", scene.tick, (seen,))
    [track] = tracker.tracks_known(terrain, scene).values()
    assert track.identity == "unknown"
    assert tell(terrain, scene, "Fox", identity="authorized").identity == "authorized"


def test_one_robot_identifies_and_of_other_sensors_it_takes_two(
    terrain: Terrain, scene: Scene
) -> None:
    assert tell(terrain, scene, "Cam", identity="authorized").identity == "unknown"
    assert tell(terrain, scene, "Eagle", identity="authorized").identity == "authorized"
    alone = scene_at()
    assert tell(terrain, alone, "Fox", identity="unauthorized").identity == "unauthorized"


def test_sources_that_contradict_each_other_leave_it_unknown_and_it_is_shown_who_says_what(
    terrain: Terrain, scene: Scene
) -> None:
    tell(terrain, scene, "Fox", identity="authorized", opinion="benign")
    track = tell(terrain, scene, "Wolf", identity="unauthorized")
    assert (track.identity, track.intent) == ("unknown", "unknown")
    assert track.identity_claims == {"Fox": "authorized", "Wolf": "unauthorized"}
    assert track.dispute == "identity disputed: Fox says authorized, Wolf says unauthorized"
    track = tell(terrain, scene, "Lynx", identity="unauthorized")
    assert (track.identity, bool(track.dispute)) == ("unauthorized", True)
    track = tell(terrain, scene, "Fox", identity="unauthorized")
    assert (track.identity, track.dispute) == ("unauthorized", "")


def test_hostile_opinions_speak_against_an_authorized_contact(
    terrain: Terrain, scene: Scene
) -> None:
    tell(terrain, scene, "Cam", opinion="hostile")
    track = tell(terrain, scene, "Fox", identity="authorized", opinion="benign")
    assert (track.identity, track.intent) == ("unknown", "unknown")
    assert track.identity_claims == {"Cam": "hostile", "Fox": "authorized"}
    track = tell(terrain, scene, "Wolf", identity="authorized", opinion="benign")
    assert (track.identity, track.intent, bool(track.dispute)) == ("authorized", "unknown", True)


def test_one_disputed_identification_makes_nobody_benign(terrain: Terrain, scene: Scene) -> None:
    tell(terrain, scene, "Fox", identity="unauthorized")
    tell(terrain, scene, "Wolf", identity="unauthorized", opinion="benign")
    track = tell(terrain, scene, "Cam", identity="authorized")
    assert (track.identity, track.intent) == ("unauthorized", "unknown")
    assert tell(terrain, scene, "Lynx", opinion="benign").intent == "benign"


def test_a_late_report_does_not_replace_what_its_sensor_has_said_since(
    terrain: Terrain, scene: Scene
) -> None:
    tell(terrain, scene, "Fox", identity="authorized")
    later(terrain, scene, 1.0)
    tell(terrain, scene, "Fox", identity="unauthorized")
    late = Detection("X", "person", WAITS, 0.5, "authorized")
    tracker.receive(terrain, scene, "Fox", scene.tick - 5, (late,))
    [track] = tracker.tracks_known(terrain, scene).values()
    assert track.identity == "unauthorized"


def test_a_suspicion_of_noncombatants_ends_when_its_sensor_does_not_repeat_it(
    terrain: Terrain, scene: Scene
) -> None:
    assert tell(terrain, scene, "Cam", noncombatants=True).noncombatants
    later(terrain, scene, WITHDRAWN_S / 2)
    assert tell(terrain, scene, "Cam").noncombatants
    later(terrain, scene, WITHDRAWN_S / 2)
    assert not tell(terrain, scene, "Cam").noncombatants
    assert tell(terrain, scene, "Cam", noncombatants=True).noncombatants


def test_a_suspicion_stays_while_its_sensor_is_too_far_to_tell(
    terrain: Terrain, scene: Scene
) -> None:
    tell(terrain, scene, "Cam", noncombatants=True)
    for _ in range(int(2 * FORGOTTEN_S / 10.0)):
        later(terrain, scene, 10.0)
        away = (0.0, RANGE_M - 5.0)
        assert tell(terrain, scene, "Cam", at=away, stands=GATE).noncombatants


def test_another_sensor_ends_a_suspicion_only_long_after_it_was_stated(
    terrain: Terrain, scene: Scene
) -> None:
    tell(terrain, scene, "Cam", noncombatants=True)
    for _ in range(5):
        later(terrain, scene, FORGOTTEN_S / 6)
        assert tell(terrain, scene, "Fox").noncombatants
    later(terrain, scene, FORGOTTEN_S / 6)
    assert not tell(terrain, scene, "Fox").noncombatants


def test_a_track_of_an_earlier_log_has_no_dispute_and_one_without_is_written_as_before(
    terrain: Terrain, scene: Scene
) -> None:
    track = tell(terrain, scene, "Fox", identity="authorized")
    text = track.model_dump_json()
    assert "identity_claims" not in text
    assert Track.model_validate_json(text) == track
    disputed = tell(terrain, scene, "Wolf", identity="unauthorized")
    assert Track.model_validate_json(disputed.model_dump_json()) == disputed


Place = Literal["none", "here", "far"]


@dataclass(frozen=True)
class Said:
    """One report of a history: `lie` is what the liar says in the truth's place."""

    sensor: str
    place: Place
    identity: Identity
    opinion: Intent
    seconds: float


HISTORIES = st.lists(
    st.builds(
        Said,
        st.sampled_from(SENSORS),
        st.sampled_from(get_args(Place)),
        st.sampled_from(get_args(Identity)),
        st.sampled_from(get_args(Intent)),
        st.sampled_from((0.0, 0.5, 2.0)),
    ),
    min_size=1,
    max_size=30,
)


@given(
    history=HISTORIES,
    liar=st.sampled_from(SENSORS),
    truth=st.tuples(
        st.sampled_from(("authorized", "unauthorized")), st.sampled_from(get_args(Intent))
    ),
)
@settings(max_examples=400, deadline=None)
def test_one_liar_makes_nobody_harmless_against_two_and_nobody_hostile(
    history: list[Said], liar: str, truth: tuple[Identity, Intent]
) -> None:
    """Honest sensors stand where they see the contact, and say the truth or nothing."""
    terrain, scene = Terrain(guarded()), scene_at()
    identity, intent = truth
    identified: set[str] = set()
    hostile: set[str] = set()
    tell(terrain, scene, "Cam" if liar != "Cam" else "Eagle")
    for said in history:
        later(terrain, scene, said.seconds)
        if said.sensor == liar:
            at = {"none": None, "here": WAITS, "far": FAR}[said.place]
            stands = FAR if said.place == "far" else GATE
            track = tell(
                terrain, scene, liar, at=at, stands=stands,
                identity=said.identity, opinion=said.opinion,
            )  # fmt: skip
        else:
            knows = said.identity != "unknown" and said.sensor in ROBOTS
            judges = said.opinion != "unknown"
            track = tell(
                terrain, scene, said.sensor,
                identity=identity if knows else "unknown",
                opinion=intent if judges else "unknown",
            )  # fmt: skip
            identified |= {said.sensor} if knows else set()
            hostile |= {said.sensor} if judges and intent == "hostile" else set()
        against = identified | hostile if identity == "unauthorized" else set[str]()
        if len(against) >= 2:
            assert track.identity != "authorized"
        if len(hostile) >= 2:
            assert track.intent == "hostile"
        if hostile or (len(identified) >= 2 and intent != "benign"):
            assert track.intent != "benign"
        if intent != "hostile":
            assert track.intent != "hostile"
