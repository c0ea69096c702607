"""The picture that a simulated camera gives of a contact."""

from io import BytesIO

from PIL import Image

from pa_console.schema.incident import Incident, SensorFault, SetWeather, SpawnTrack
from pa_console.sim.camera_view import SIZE, look_of
from tests.stills import CAMERA, VEHICLE, drawn, fleet_with

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
