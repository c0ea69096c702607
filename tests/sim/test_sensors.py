"""Who detects what: range, field of view, walls, weather, chance, noise, faults, phantoms."""

import statistics
from io import BytesIO
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from pa_console.schema.base import Point
from pa_console.schema.incident import FalseContact, Incident, SensorFault, SetWeather, SpawnTrack
from pa_console.schema.world import AssetKind, Sensing
from pa_console.sim import incidents, telemetry
from pa_console.sim.camera_view import SIZE, look_of
from pa_console.sim.scene import Scene
from pa_console.sim.sensing.sensors import AT_FULL_RANGE, detection_chance, scan
from pa_console.sim.worlds.terrain import Terrain
from tests.sim.lookout import RANGE_M, lookout, scene_at, stand
from tests.stills import CAMERA, VEHICLE, drawn, fleet_with

HERE: Point = (0.0, -10.0)


def seen_at(terrain: Terrain, scene: Scene, at: Point, **truth: Any) -> set[str]:
    """Return which sensors detect a contact that stands at a point."""
    stand(terrain, scene, at, **truth)
    return set(scan(terrain, scene))


@pytest.mark.parametrize(("gap_m", "seen"), [(RANGE_M - 0.1, True), (RANGE_M + 0.1, False)])
@pytest.mark.parametrize("kind", ["uav", "ugv", "robot"])
def test_a_sensor_reaches_as_far_as_its_range(kind: AssetKind, gap_m: float, seen: bool) -> None:
    terrain = Terrain(lookout())
    scene = scene_at(("Eye", kind, HERE))
    scene.ideal = True
    assert bool(seen_at(terrain, scene, (0.0, HERE[1] + gap_m))) is seen


@pytest.mark.parametrize(
    ("at", "seen"),
    [((8.0, 20.0), True), ((26.0, 20.0), True), ((28.5, 20.0), False), ((8.0, -10.0), False)],
)
def test_a_camera_sees_only_what_is_in_its_field_of_view(at: Point, seen: bool) -> None:
    terrain = Terrain(lookout(cameras={"Cam": {"field_of_view_deg": 90.0}}))
    assert ("Cam" in seen_at(terrain, scene_at(), at)) is seen


def test_a_field_of_view_turns_with_its_asset() -> None:
    terrain = Terrain(lookout(sensor={"field_of_view_deg": 60.0}))
    scene = scene_at(("Fox", "robot", HERE))
    stand(terrain, scene, (0.0, 10.0))
    assert scan(terrain, scene) == {}
    scene.assets["Fox"].heading = 1.57
    assert set(scan(terrain, scene)) == {"Fox"}


def test_a_field_of_view_goes_across_the_west() -> None:
    terrain = Terrain(lookout(cameras={"Cam": {"heading_deg": 180.0, "field_of_view_deg": 20.0}}))
    scene = scene_at()
    for at in ((-20.0, 3.0), (-20.0, -1.0)):
        stand(terrain, scene, at)
    assert len(scan(terrain, scene)["Cam"]) == 2


def test_walls_block_ground_sensors_and_cameras_but_no_uav() -> None:
    terrain = Terrain(lookout(walls=(((-20.0, 10.0), (20.0, 10.0)),), cameras={"Cam": {}}))
    scene = scene_at(("Eagle", "uav", HERE), ("Mule", "ugv", HERE), ("Fox", "robot", HERE))
    assert seen_at(terrain, scene, (0.0, 20.0)) == {"Eagle"}
    assert seen_at(terrain, scene, (0.0, 5.0)) == {"Eagle", "Mule", "Fox", "Cam"}


def test_detections_get_rarer_with_the_distance() -> None:
    terrain = Terrain(lookout(sensor={"detection_probability": 0.9}))
    rates: list[float] = []
    for gap_m in (5.0, RANGE_M):
        scene = scene_at(("Fox", "robot", HERE), seed=3)
        stand(terrain, scene, (0.0, HERE[1] + gap_m))
        rates.append(sum(bool(scan(terrain, scene)) for _ in range(1000)) / 1000)
    assert rates == pytest.approx([0.9, 0.9 * AT_FULL_RANGE], abs=0.06)


@given(chance=st.floats(0, 1), reach=st.floats(0.1, 1e4), parts=st.tuples(*[st.floats(0, 1)] * 2))
def test_the_chance_never_grows_with_the_distance(
    chance: float, reach: float, parts: tuple[float, float]
) -> None:
    spec = Sensing(sensor_range_m=reach, detection_probability=chance)
    near, far = sorted(parts)
    at_near, at_far = (detection_chance(spec, part * reach, reach) for part in (near, far))
    assert 0.0 <= at_far <= at_near <= chance


def test_positions_have_the_sensors_noise() -> None:
    terrain = Terrain(lookout(sensor={"position_noise_m": 4.0}))
    scene = scene_at(("Fox", "robot", HERE), seed=5)
    contact = stand(terrain, scene, (0.0, HERE[1] + 1.0))
    found = [scan(terrain, scene)["Fox"][0] for _ in range(1000)]
    for axis in (0, 1):
        values = [d.position[axis] for d in found if d.position is not None]
        assert statistics.mean(values) == pytest.approx(contact.position[axis], abs=0.5)
        assert statistics.stdev(values) == pytest.approx(4.0, rel=0.1)
    assert {d.sigma_m for d in found} == {4.0}


@pytest.mark.parametrize("sensor", ["Fox", "Cam"])
def test_a_broken_sensor_sees_nothing_until_it_works_again(sensor: str) -> None:
    terrain = Terrain(lookout(cameras={"Cam": {}}))
    scene = scene_at(("Fox", "robot", HERE))
    stand(terrain, scene, (0.0, 10.0))
    incidents.apply(terrain, scene, SensorFault(sensor=sensor))
    assert set(scan(terrain, scene)) == {"Fox", "Cam"} - {sensor}
    report = telemetry.cameras_known(terrain, scene)["Cam"]
    assert (report.gate, report.works) == ("Gate", sensor != "Cam")
    incidents.apply(terrain, scene, SensorFault(sensor=sensor, works=True))
    assert set(scan(terrain, scene)) == {"Fox", "Cam"}


def test_an_asset_that_is_down_sees_nothing() -> None:
    terrain = Terrain(lookout())
    scene = scene_at(("Fox", "robot", HERE), ("Eagle", "uav", HERE))
    scene.assets["Fox"].failed = True
    scene.assets["Eagle"].battery = 0.0
    assert seen_at(terrain, scene, (0.0, 10.0)) == set()


def test_weather_shortens_the_range_and_hides_more() -> None:
    terrain = Terrain(lookout())
    scene = scene_at(("Fox", "robot", HERE), seed=8)
    stand(terrain, scene, (0.0, HERE[1] + 0.6 * RANGE_M))
    rates: dict[str, int] = {}
    for weather in ("clear", "rain", "fog"):
        incidents.apply(terrain, scene, SetWeather(weather=weather))
        assert scene.sensing.weather == weather
        rates[weather] = sum(bool(scan(terrain, scene)) for _ in range(300))
    assert rates["clear"] > rates["rain"] > rates["fog"] == 0


def test_a_phantom_is_seen_by_one_sensor_for_a_while() -> None:
    terrain = Terrain(lookout(cameras={"Cam": {}, "Other": {}}))
    scene = scene_at(("Fox", "robot", HERE))
    incidents.apply(terrain, scene, FalseContact(gate="Gate", seconds=5.0))
    assert scene.contacts == {}
    places: list[Point | None] = []
    for scene.tick in range(50):
        found = scan(terrain, scene)
        assert set(found) == {"Cam"}
        places.append(found["Cam"][0].position)
    assert len(set(places)) == 50
    scene.tick = 50
    assert scan(terrain, scene) == {}


def test_a_phantom_goes_with_the_sensor_that_imagines_it() -> None:
    terrain = Terrain(lookout(cameras={"Cam": {}}))
    scene = scene_at()
    incidents.apply(terrain, scene, FalseContact(gate="Gate"))
    incidents.apply(terrain, scene, SensorFault(sensor="Cam"))
    assert scan(terrain, scene) == {}


def test_faults_and_phantoms_on_unknown_names_say_what_exists() -> None:
    terrain, scene = Terrain(lookout(cameras={"Cam": {}})), scene_at()
    with pytest.raises(ValueError, match=r"no sensor 'Nose'.*Fox.*Cam"):
        incidents.apply(terrain, scene, SensorFault(sensor="Nose"))
    with pytest.raises(ValueError, match=r"no gate 'Post'.*Gate"):
        incidents.apply(terrain, scene, FalseContact(gate="Post"))


def test_a_robot_that_identifies_sees_what_is_at_its_gate_for_certain() -> None:
    terrain = Terrain(lookout(walls=(((-20.0, 3.0), (20.0, 3.0)),)))
    scene = scene_at(("Fox", "robot", HERE))
    incidents.apply(terrain, scene, SetWeather(weather="fog"))
    stand(terrain, scene, (0.0, HERE[1] + 0.9 * RANGE_M))
    assert scan(terrain, scene) == {}
    scene.assets["Fox"].task, scene.assets["Fox"].post = "identifying", "Gate"
    assert set(scan(terrain, scene)) == {"Fox"}


RED, GREEN = (176, 32, 36), (38, 110, 62)


def picture(*incidents: Incident, seed: int = 7, track: str = "Track_01") -> Image.Image:
    """Return what the north camera sees after `incidents`."""
    make = fleet_with(*incidents, seed=seed).still(CAMERA, track)
    assert make is not None
    return Image.open(BytesIO(make()))


def share(image: Image.Image, colour: tuple[int, int, int]) -> float:
    """Return how much of a picture has exactly a colour."""
    found = {pixel: number for number, pixel in image.getcolors(SIZE[0] * SIZE[1]) or ()}
    return found.get(colour, 0) / (SIZE[0] * SIZE[1])


def test_equal_sessions_give_equal_pictures() -> None:
    make = fleet_with(VEHICLE).still(CAMERA, "Track_01")
    assert make is not None
    assert make() == make() == drawn()
    other = fleet_with(VEHICLE, seed=8).still(CAMERA, "Track_01")
    assert other is not None
    assert other() != drawn()


def test_colour_and_plate_follow_from_the_contact_and_the_seed() -> None:
    assert look_of("contact_1", 7) == look_of("contact_1", 7)
    looks = {look_of(f"contact_{number}", 7) for number in range(200)}
    assert len(looks) == 200
    assert len({look.colour for look in looks}) == 8


def test_a_vehicle_has_its_colour_and_an_emergency_vehicle_is_white_with_a_blue_light() -> None:
    assert share(picture(VEHICLE), RED) > 0.02
    ambulance = VEHICLE.model_copy(update={"emergency": True})
    assert share(picture(ambulance), RED) == 0.0
    assert share(picture(ambulance), (232, 232, 228)) > 0.02
    assert share(picture(ambulance), (40, 90, 240)) > 0.0


def test_a_person_is_no_vehicle() -> None:
    person = picture(SpawnTrack(gate="NorthGate", track="person", distance_m=30.0))
    assert share(person, (206, 164, 132)) > 0.001, "a face"
    assert share(picture(VEHICLE), (206, 164, 132)) == 0.0


def test_fog_takes_the_contrast() -> None:
    clear, fog = picture(VEHICLE), picture(VEHICLE, SetWeather(weather="fog"))
    bright = [image.convert("L").histogram() for image in (clear, fog)]
    levels = [[level for level, number in enumerate(each) if number] for each in bright]
    assert levels[1][-1] - levels[1][0] < 0.7 * (levels[0][-1] - levels[0][0])


def test_a_broken_camera_gives_none_and_looking_changes_no_history() -> None:
    fleet = fleet_with(VEHICLE)
    before = fleet.checkpoint.state_hash()
    make = fleet.still(CAMERA, "Track_01")
    assert make is not None
    make()
    assert fleet.checkpoint.state_hash() == before
    assert fleet.still(CAMERA, "Track_99") is None
    fleet.inject(SensorFault(sensor=CAMERA))
    assert fleet.still(CAMERA, "Track_01") is None
