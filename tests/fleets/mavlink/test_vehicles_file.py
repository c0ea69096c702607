"""What is wrong with a file of drones is said with its line, its field and the remedy."""

from pathlib import Path

import pytest

from pa_console.fleets.mavlink.link import open_link
from pa_console.fleets.mavlink.vehicles_file import read_vehicles
from pa_console.schema.document import DocumentError
from pa_console.schema.world import World
from pa_console.settings.schema import Settings
from tests.fleets.mavlink.scripted import ORIGIN


def written(folder: Path, text: str) -> Path:
    path = folder / "drones.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_most_particular_altitude_counts(tmp_path: Path, world: World) -> None:
    text = """
        altitude_m: 20
        altitudes_m: {observe: 30}
        vehicles:
          Drone_T01: {system_id: 1}
          Drone_T02: {system_id: 2, altitude_m: 25}
          Drone_T03: {system_id: 3, altitude_m: 25, altitudes_m: {observe: 40}}
    """
    found = read_vehicles(written(tmp_path, text), world)
    heights = {
        name: (found.altitude(name, "move_to"), found.altitude(name, "observe"))
        for name in found.vehicles
    }
    assert heights == {
        "Drone_T01": (20.0, 30.0), "Drone_T02": (25.0, 25.0), "Drone_T03": (25.0, 40.0)
    }  # fmt: skip


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("vehicles:\n  Drone_T09: {system_id: 1}\n", ":2: vehicles.Drone_T09: .*Drone_T01"),
        ("vehicles:\n  Ugv_T01: {system_id: 1}\n", ":2: vehicles.Ugv_T01: is a ugv"),
        ("vehicles:\n  Drone_T01: {system_id: 300}\n", ":2: vehicles.Drone_T01.system_id"),
        (
            "vehicles:\n  Drone_T01: {system_id: 1}\n  Drone_T02: {system_id: 1}\n",
            ":3: vehicles.Drone_T02.system_id: 1 is the system id of Drone_T01 too",
        ),
        (
            "ceiling_m: 30\nvehicles:\n  Drone_T01: {system_id: 1, altitude_m: 40}\n",
            ":3: vehicles.Drone_T01: move_to at 40 m is outside 5 to 30 m: change the altitude",
        ),
        (
            "floor_m: 50\nceiling_m: 30\nvehicles:\n  Drone_T01: {system_id: 1}\n",
            ":1: floor_m: 50 m is above ceiling_m",
        ),
        ("vehicles: {}\n", ":1: vehicles"),
    ],
)
def test_a_wrong_file_is_refused_with_line_field_and_remedy(
    tmp_path: Path, world: World, text: str, words: str
) -> None:
    with pytest.raises(DocumentError, match=words):
        read_vehicles(written(tmp_path, text), world)


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("udp://0.0.0.0:14540", r"which drone is which\?.*#FILE.yaml"),
        ("none.yaml", "none.yaml"),
        ("drones.yaml", "connection: missing; give for example udp://0.0.0.0:14540"),
        ("udq://0.0.0.0:14540#drones.yaml", "is not a connection; give udp://0.0.0.0:PORT"),
        ("udp://0.0.0.0#drones.yaml", r"cannot be opened \(connection url invalid\)"),
    ],
)
def test_a_wrong_address_is_refused_with_the_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, world: World, address: str, words: str
) -> None:
    written(tmp_path, "vehicles:\n  Drone_T01: {system_id: 1}\n")
    monkeypatch.chdir(tmp_path)
    there = world.model_copy(update={"origin": ORIGIN})
    with pytest.raises(ValueError, match=words):
        open_link(address, there, Settings())


def test_a_world_that_is_nowhere_on_the_earth_is_refused(tmp_path: Path, world: World) -> None:
    path = written(tmp_path, "vehicles:\n  Drone_T01: {system_id: 1}\n")
    nowhere = world.model_copy(update={"origin": None})
    with pytest.raises(ValueError, match="has no position on the earth"):
        open_link(f"udp://127.0.0.1:14599#{path}", nowhere, Settings())


def test_another_origin_than_the_worlds_is_refused(tmp_path: Path, world: World) -> None:
    text = "origin: {latitude: 1.0, longitude: 1.0}\nvehicles:\n  Drone_T01: {system_id: 1}\n"
    there = world.model_copy(update={"origin": ORIGIN})
    with pytest.raises(ValueError, match="different origins"):
        open_link(f"udp://127.0.0.1:14599#{written(tmp_path, text)}", there, Settings())
