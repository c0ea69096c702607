"""What the station makes of detections: estimates, status, identity, intent, defiance, age."""

import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.schema.base import Point
from pa_console.schema.incident import ClearTracks, FalseContact, RevealTrack
from pa_console.schema.telemetry import Intent, Track
from pa_console.sim import contacts, incidents, truth
from pa_console.sim.devices import IDENTIFY_S, WARN_S, attend
from pa_console.sim.scene import Scene
from pa_console.sim.sensing import sensors, tracker
from pa_console.sim.sensing.sensors import WATCH_S
from pa_console.sim.sensing.tracker import DROP_S
from pa_console.sim.sensing_state import ContactState, Detection
from pa_console.sim.worlds.terrain import Terrain
from tests.sim.lookout import lookout, reports_from, scene_at, stand

WAITS: Point = (0.0, 9.0)
GATE: Point = (0.0, -6.0)


@pytest.fixture
def terrain() -> Terrain:
    return Terrain(lookout(cameras={"Cam": {}}))


@pytest.fixture
def scene() -> Scene:
    return scene_at()


def tell(
    terrain: Terrain, scene: Scene, sensor: str, at: Point | None = WAITS, **what: object
) -> Track:
    """Let a sensor that stands at the gate report a contact now; return the only track."""
    reports_from(terrain, scene, sensor, GATE)
    told = {"contact": "X", "kind": "vehicle", "position": at, "sigma_m": 0.5} | what
    tracker.receive(terrain, scene, sensor, scene.tick, (Detection(**told),))  # pyright: ignore[reportArgumentType]
    return only(terrain, scene)


def only(terrain: Terrain, scene: Scene) -> Track:
    [track] = tracker.tracks_known(terrain, scene).values()
    return track


def watch(terrain: Terrain, scene: Scene, seconds: float) -> None:
    """Let contacts move and every sensor's detections arrive at once, for some seconds."""
    period = round(terrain.world.telemetry_period_s / terrain.world.dt_s)
    for _ in range(round(seconds / terrain.world.dt_s)):
        scene.tick += 1
        contacts.advance(terrain, scene, terrain.world.dt_s)
        if scene.tick % period == 0:
            for name, asset in scene.assets.items():
                reports_from(terrain, scene, name, asset.position)
            for sensor, detections in sensors.scan(terrain, scene).items():
                tracker.receive(terrain, scene, sensor, scene.tick, detections)
            tracker.tracks_known(terrain, scene)


def deal(terrain: Terrain, scene: Scene, verb: str) -> str:
    """Let Fox identify or warn whoever is at the gate, and report; return what it answers."""
    seconds = IDENTIFY_S if verb == "identify" else WARN_S
    status, detail = None, ""
    scene.assets["Fox"].dwell = 0
    for _ in range(math.ceil(seconds / terrain.world.dt_s) + 1):
        status, detail = attend(terrain, scene, scene.assets["Fox"], verb, "Gate")  # pyright: ignore[reportArgumentType]
        if status is not None:
            break
    assert status == "done"
    return detail


def test_tracks_are_numbered_in_the_order_of_detection(terrain: Terrain, scene: Scene) -> None:
    for contact in ("C", "A", "B"):
        heard = Detection(contact=contact, kind="person", position=WAITS, sigma_m=1.0)
        tracker.receive(terrain, scene, "Cam", 0, (heard,))
    assert list(tracker.tracks_known(terrain, scene)) == ["Track_01", "Track_02", "Track_03"]
    assert [file.contact for file in scene.sensing.files.values()] == ["C", "A", "B"]


def test_nothing_detected_is_no_track(terrain: Terrain, scene: Scene) -> None:
    stand(terrain, scene, (0.0, 250.0))
    watch(terrain, scene, 5.0)
    assert tracker.tracks_known(terrain, scene) == {}
    assert len(truth.true_tracks(terrain, scene)) == 1


def test_an_undetected_track_gets_stale_unsure_and_is_dropped(
    terrain: Terrain, scene: Scene
) -> None:
    fresh = tell(terrain, scene, "Eagle")
    scene.tick = round((terrain.world.stale_s + 0.5) / terrain.world.dt_s)
    old = only(terrain, scene)
    assert (fresh.stale, fresh.seen_by, fresh.observed_by) == (False, ("Eagle",), ("Eagle",))
    assert (old.stale, old.seen_by, old.observed_by, old.observed) == (True, (), (), True)
    assert (old.stamp_s, old.first_seen_s, old.position) == (0.0, 0.0, fresh.position)
    scene.tick = round(DROP_S / terrain.world.dt_s)
    assert tracker.tracks_known(terrain, scene) == {}
    assert tell(terrain, scene, "Eagle").id == "Track_02"


def test_a_moving_track_gets_less_certain_while_nobody_sees_it(
    terrain: Terrain, scene: Scene
) -> None:
    stand(terrain, scene, (0.0, 35.0), speed_mps=5.0)
    scene.assets.update(scene_at(("Fox", "robot", GATE)).assets)
    watch(terrain, scene, 3.0)
    seen = only(terrain, scene)
    scene.tick += 20
    assert only(terrain, scene).uncertainty_m == pytest.approx(seen.uncertainty_m + 10.0, abs=0.5)


@given(
    seed=st.integers(0, 2**32),
    sigma=st.floats(0.05, 10.0),
    start=st.tuples(st.floats(-300, 300), st.floats(-300, 300)),
    velocity=st.tuples(st.floats(-12, 12), st.floats(-12, 12)),
    sensors=st.integers(1, 3),
)
@settings(max_examples=80, deadline=None)
def test_the_estimate_stays_within_a_few_sigma(
    seed: int, sigma: float, start: Point, velocity: Point, sensors: int
) -> None:
    terrain, scene, rng = Terrain(lookout()), scene_at(), random.Random(seed)
    for scene.tick in range(0, 100, 5):
        seconds = scene.tick * terrain.world.dt_s
        true = (start[0] + velocity[0] * seconds, start[1] + velocity[1] * seconds)
        for number in range(sensors):
            at = (rng.gauss(true[0], sigma), rng.gauss(true[1], sigma))
            track = tell(terrain, scene, f"S{number}", at, sigma_m=sigma)
            assert math.dist(track.position, true) <= 6.0 * track.uncertainty_m + 0.01
            assert track.uncertainty_m <= sigma + 0.001


def test_more_sensors_make_the_estimate_better(terrain: Terrain, scene: Scene) -> None:
    alone = tell(terrain, scene, "Cam").uncertainty_m
    assert tell(terrain, scene, "Eagle").uncertainty_m < 0.8 * alone


def test_a_late_detection_does_not_pull_a_track_back(terrain: Terrain, scene: Scene) -> None:
    track = tell(terrain, scene, "Cam", (0.0, 100.0))
    for scene.tick in range(5, 60, 5):
        track = tell(terrain, scene, "Cam", (0.0, 100.0 - scene.tick * 0.5))
    late = Detection(contact="X", kind="vehicle", position=(0.0, 82.5), sigma_m=0.5)
    tracker.receive(terrain, scene, "Eagle", 35, (late,))
    after = only(terrain, scene)
    assert after.stamp_s == track.stamp_s
    assert after.distance_m == pytest.approx(track.distance_m, abs=0.3)
    assert after.observed


@pytest.mark.parametrize("sigma", [0.0, 2.0, 10.0])
def test_noise_does_not_flip_the_status(sigma: float) -> None:
    for seed in range(10):
        terrain = Terrain(lookout(sensor={"position_noise_m": sigma, "sensor_range_m": 120.0}))
        scene = scene_at(("Eagle", "uav", GATE), ("Fox", "robot", GATE), seed=seed)
        stand(terrain, scene, (0.0, 94.0), speed_mps=8.0)
        watch(terrain, scene, 2.0)
        seen: list[str] = []
        for _ in range(100):
            watch(terrain, scene, 0.5)
            status = only(terrain, scene).status
            if not seen or seen[-1] != status:
                seen.append(status)
        assert seen == ["approaching", "stopped"]
        assert only(terrain, scene).speed_mps == 0.0


def test_a_hostile_contact_takes_two_sensors(terrain: Terrain, scene: Scene) -> None:
    tell(terrain, scene, "Cam", opinion="hostile")
    one = tell(terrain, scene, "Cam", opinion="hostile")
    assert (one.intent, one.hostile_by) == ("unknown", ("Cam",))
    two = tell(terrain, scene, "Eagle", opinion="hostile")
    assert (two.intent, two.hostile_by) == ("hostile", ("Cam", "Eagle"))
    back = tell(terrain, scene, "Cam", opinion="benign")
    assert (back.intent, back.hostile_by) == ("unknown", ("Eagle",))


@given(
    told=st.lists(
        st.tuples(
            st.sampled_from(["Cam", "Eagle", "Fox", "Mule"]),
            st.sampled_from(["unknown", "benign", "hostile"]),
            st.sampled_from(["unknown", "authorized", "unauthorized"]),
        ),
        min_size=1,
        max_size=12,
    )
)
@settings(max_examples=100, deadline=None)
def test_hostile_implies_two_independent_sensors(told: list[tuple[str, Intent, str]]) -> None:
    terrain, scene = Terrain(lookout(cameras={"Cam": {}})), scene_at()
    said: dict[str, Intent] = {}
    for sensor, opinion, identity in told:
        track = tell(terrain, scene, sensor, opinion=opinion, identity=identity)
        if opinion != "unknown":
            said[sensor] = opinion
        hostile = {name for name, what in said.items() if what == "hostile"}
        assert set(track.hostile_by) == hostile
        assert (track.intent == "hostile") == (len(hostile) >= 2)
        assert track.intent != "benign" or not hostile


def test_watching_long_at_close_range_forms_an_opinion(terrain: Terrain, scene: Scene) -> None:
    scene.assets.update(scene_at(("Eagle", "uav", GATE)).assets)
    stand(terrain, scene, WAITS, intent="hostile", name="foe")
    watch(terrain, scene, WATCH_S - 1.0)
    assert only(terrain, scene).hostile_by == ()
    watch(terrain, scene, 2.0)
    track = only(terrain, scene)
    assert (track.intent, track.identity) == ("hostile", "unknown")
    assert track.hostile_by == ("Cam", "Eagle")
    contacts.turn(scene, RevealTrack(track="foe", intent="benign"))
    watch(terrain, scene, WATCH_S - 1.0)
    assert only(terrain, scene).intent == "hostile"
    watch(terrain, scene, 2.0)
    assert only(terrain, scene).intent == "benign"


def test_nobody_tells_intent_or_noncombatants_from_afar(terrain: Terrain) -> None:
    scene = scene_at(("Eagle", "uav", GATE))
    far = stand(terrain, scene, (0.0, 30.0), intent="hostile", noncombatants=True)
    far.when_warned, far.warned_tick = "stop", 0
    watch(terrain, scene, 3 * WATCH_S)
    track = only(terrain, scene)
    assert (track.intent, track.hostile_by, track.noncombatants) == ("unknown", (), False)
    far.x, far.y = WAITS
    watch(terrain, scene, 1.0)
    assert only(terrain, scene).noncombatants


def test_only_identify_finds_the_identity(terrain: Terrain) -> None:
    scene = scene_at(("Fox", "robot", GATE), ("Eagle", "uav", GATE))
    stand(terrain, scene, WAITS, identity="authorized")
    watch(terrain, scene, 30.0)
    assert only(terrain, scene).identity == "unknown"
    assert deal(terrain, scene, "identify") == "Track_01 is authorized, looks benign"
    assert only(terrain, scene).identity == "unknown"
    watch(terrain, scene, 0.5)
    assert (only(terrain, scene).identity, only(terrain, scene).intent) == ("authorized", "benign")


def test_identify_alone_does_not_confirm_hostility(terrain: Terrain) -> None:
    scene = scene_at(("Fox", "robot", GATE))
    scene.sensing.broken = ("Cam",)
    stand(terrain, scene, WAITS, identity="unauthorized", intent="hostile")
    assert deal(terrain, scene, "identify") == "a vehicle is unauthorized, looks hostile"
    watch(terrain, scene, 30.0)
    track = only(terrain, scene)
    assert (track.identity, track.intent, track.hostile_by) == ("unauthorized", "unknown", ("Fox",))


def test_what_a_robot_has_just_identified_stays_in_its_proximity_sensors() -> None:
    """In fog the robot does not see the contact any more, and its report still counts."""
    terrain = Terrain(lookout(sensor={"detection_probability": 0.0}))
    scene = scene_at(("Fox", "robot", GATE))
    stand(terrain, scene, WAITS, identity="authorized")
    scene.assets["Fox"].post = "Gate"
    tell(terrain, scene, "Eagle", contact=next(iter(scene.contacts)))
    deal(terrain, scene, "identify")
    watch(terrain, scene, 0.5)
    assert only(terrain, scene).identity == "authorized"


def test_what_a_robot_found_out_is_in_every_report_of_it_and_counts_from_where_it_saw_it(
    terrain: Terrain,
) -> None:
    scene = scene_at(("Fox", "robot", GATE))
    contact = stand(terrain, scene, WAITS, identity="authorized")
    watch(terrain, scene, 1.0)
    deal(terrain, scene, "identify")
    scene.assets["Fox"].x = 500.0
    [told] = sensors.scan(terrain, scene)["Fox"]
    assert (told.contact, told.position, told.identity) == (contact.id, None, "authorized")
    tracker.receive(terrain, scene, "Fox", scene.tick, (told,))
    assert only(terrain, scene).identity == "unknown"
    scene.assets["Fox"].x = GATE[0]
    watch(terrain, scene, 0.5)
    assert only(terrain, scene).identity == "authorized"
    scene.assets["Fox"].x = 500.0
    watch(terrain, scene, 5.0)
    assert only(terrain, scene).identity == "authorized"


@pytest.mark.parametrize(
    ("reaction", "defiant", "status"),
    [("leave", False, "leaving"), ("stop", False, "stopped"), ("go_on", True, "inside")],
)
def test_defiance_is_seen_after_the_warning(
    terrain: Terrain, reaction: str, defiant: bool, status: str
) -> None:
    scene = scene_at(("Fox", "robot", GATE), ("Eagle", "uav", GATE))
    stand(terrain, scene, WAITS, when_warned=reaction)
    watch(terrain, scene, 2.0)
    assert deal(terrain, scene, "warn") == "warned Track_01"
    assert not only(terrain, scene).warned
    watch(terrain, scene, 10.0)
    track = only(terrain, scene)
    assert (track.warned, track.defiant, track.status) == (True, defiant, status)


def test_a_phantom_is_a_track_that_nobody_finds_at_the_gate(terrain: Terrain, scene: Scene) -> None:
    scene.assets.update(scene_at(("Fox", "robot", GATE)).assets)
    incidents.apply(terrain, scene, FalseContact(gate="Gate", seconds=5.0))
    watch(terrain, scene, 3.0)
    assert only(terrain, scene).seen_by == ("Cam",)
    assert truth.true_tracks(terrain, scene) == {}
    answer = attend(terrain, scene, scene.assets["Fox"], "identify", "Gate")
    assert answer == ("failed", "no track at Gate")
    watch(terrain, scene, DROP_S + 3.0)
    assert tracker.tracks_known(terrain, scene) == {}


def test_cleared_tracks_do_not_come_back_with_a_late_report(terrain: Terrain) -> None:
    scene = scene_at(("Fox", "robot", GATE))
    stand(terrain, scene, WAITS)
    incidents.apply(terrain, scene, FalseContact(gate="Gate"))
    late = sensors.scan(terrain, scene)
    watch(terrain, scene, 1.0)
    assert len(tracker.tracks_known(terrain, scene)) == 2
    incidents.apply(terrain, scene, ClearTracks(gate="Gate"))
    for sensor, detections in late.items():
        tracker.receive(terrain, scene, sensor, scene.tick, detections)
    assert tracker.tracks_known(terrain, scene) == truth.true_tracks(terrain, scene) == {}


def test_the_truth_stands_under_the_tracks_id(terrain: Terrain) -> None:
    scene = scene_at(("Fox", "robot", GATE))
    stand(terrain, scene, WAITS, identity="authorized", intent="hostile")
    unseen: ContactState = stand(terrain, scene, (0.0, 200.0))
    watch(terrain, scene, 1.0)
    exact = truth.true_tracks(terrain, scene)
    assert set(exact) == {"Track_01", unseen.id}
    assert (exact["Track_01"].identity, exact["Track_01"].intent) == ("authorized", "hostile")
