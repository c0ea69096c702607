"""A robot's map is read as its map server would read it, and drawn where its places are."""

import cmath
import math
from pathlib import Path

import numpy as np
import pytest

from pa_console.schema.document import DocumentError
from pa_console.schema.world import MOST_ROWS, Background
from pa_console.sim.worlds.occupancy_map import background_of, read_occupancy_map
from pa_console.tui.map.scene import MapScene
from tests.tui.site import WORLD, picture

ROOM = {"image": "room.pgm", "resolution": 0.5, "origin": "[-1.0, 2.0, 0.0]"}
PIXELS = ((0, 255, 205), (0, 254, 100))
"""Two rows, the first one north: black is occupied, white is free, 205 is unknown."""


def write(folder: Path, pgm: bytes, **fields: object) -> Path:
    lines = [f"{name}: {value}" for name, value in (ROOM | fields).items()]
    path = folder / "room.yaml"
    path.write_text("\n".join(lines), encoding="utf-8")
    (folder / "room.pgm").write_bytes(pgm)
    return path


def binary(pixels: tuple[tuple[int, ...], ...] = PIXELS) -> bytes:
    head = f"P5\n# made by hand\n{len(pixels[0])} {len(pixels)}\n255\n".encode()
    return head + b"".join(bytes(row) for row in pixels)


def text(pixels: tuple[tuple[int, ...], ...] = PIXELS) -> bytes:
    rows = "\n".join(" ".join(map(str, row)) for row in pixels)
    return f"P2 {len(pixels[0])} {len(pixels)}\n255\n{rows}\n".encode()


@pytest.mark.parametrize("image", [binary(), text()], ids=["P5", "P2"])
def test_black_is_occupied_white_is_free_and_grey_is_unknown(image: bytes, tmp_path: Path) -> None:
    found = read_occupancy_map(write(tmp_path, image, occupied_thresh=0.65, free_thresh=0.196))
    assert found == Background(origin=(-1.0, 2.0), cell_m=0.5, rows=("#.?", "#.?"))
    assert found.is_occupied((-0.9, 2.1))
    assert found.is_occupied((-0.6, 2.9))
    assert not found.is_occupied((-0.4, 2.1))
    assert not found.is_occupied((-1.1, 2.1))


def test_negate_turns_black_and_white_round(tmp_path: Path) -> None:
    found = read_occupancy_map(write(tmp_path, binary(), negate=1))
    assert found.rows == (".##", ".#?")


def test_a_large_map_keeps_its_corner_and_every_occupied_spot(tmp_path: Path) -> None:
    width = 2 * MOST_ROWS + 1
    pixels = bytearray(b"\xff" * width * 3)
    pixels[2 * width] = 0  # the lower left corner
    pixels[width - 1] = 0  # the upper right one
    image = f"P5 {width} 3 255\n".encode() + bytes(pixels)
    found = read_occupancy_map(write(tmp_path, image, resolution=0.05))
    assert found.cell_m == pytest.approx(0.15)
    assert len(found.rows[0]) <= MOST_ROWS
    assert found.rows == ("#" + "." * (len(found.rows[0]) - 2) + "#",)


@pytest.mark.parametrize(
    ("image", "fields", "says"),
    [
        (binary(), {"resolution": -1}, "resolution"),
        (binary(), {"origin": "[0.0, 0.0, 0.3]"}, "origin"),
        (binary(), {"origin": "[0.0, 0.0]"}, "origin"),
        (binary(), {"mode": "raw"}, "mode"),
        (binary(), {"free_thresh": 0.9}, "free_thresh"),
        (binary(), {"image": "room.png"}, "convert it"),
        (binary(), {"image": "other.pgm"}, "other.pgm"),
        (binary()[:-1], {}, "cut off"),
        (b"P6 1 1 255 xxx", {}, "not a PGM image"),
        (b"P5 1 x 255 xxx", {}, "not a PGM image"),
        (b"P5 99999 99999 255 xxx", {}, "cannot be read"),
        (b"P2 2 1 255 7 x", {}, "not a number"),
        (b"", {}, "not a PGM image"),
    ],
    ids=lambda value: str(value)[:24],
)
def test_what_cannot_be_read_is_named(
    image: bytes, fields: dict[str, object], says: str, tmp_path: Path
) -> None:
    with pytest.raises(DocumentError, match=says):
        read_occupancy_map(write(tmp_path, image, **fields))


@pytest.mark.parametrize("turn", [0.0, 0.4, math.pi / 4, -2.5])
def test_a_turned_map_has_its_walls_where_they_are_and_no_gaps(turn: float) -> None:
    occupied = np.ones((300, 500), np.bool_)
    ground = background_of(occupied, ~occupied, (3.0, -4.0), 0.1, turn)
    assert max(len(ground.rows), len(ground.rows[0])) <= MOST_ROWS
    for x, y in ((0.3, 0.3), (49.0, 0.5), (25.0, 15.0), (0.5, 29.0), (49.0, 29.0)):
        at = complex(3.0, -4.0) + complex(x, y) * cmath.exp(1j * turn)
        assert ground.is_occupied((at.real, at.imag)), (x, y)
    outside = complex(3.0, -4.0) + complex(-2.0, -2.0) * cmath.exp(1j * turn)
    assert not ground.is_occupied((outside.real, outside.imag))


def test_a_map_that_robots_make_takes_the_place_of_the_world_s() -> None:
    under = Background(origin=(-15.0, -15.0), cell_m=1.0, rows=("#" * 30,) * 30)
    scene = MapScene(WORLD)
    assert not any("▒" in line for line in scene.draw(picture(), 100, 30).lines())
    scene.lay(under)
    assert any("▒" in line for line in scene.draw(picture(), 100, 30).lines())


@pytest.mark.parametrize("cell_m", [1.0, 30.0])
def test_it_lies_under_everything_on_the_map(cell_m: float) -> None:
    under = Background(origin=(-15.0, -15.0), cell_m=cell_m, rows=("#" * 30,) * 30)
    scene = MapScene(WORLD.model_copy(update={"background": under}))
    bare, shaded = (s.draw(picture(), 100, 30) for s in (MapScene(WORLD), scene))
    assert not any("▒" in line for line in bare.lines())
    assert sum(line.count("▒") for line in shaded.lines()) > 20
    for glyph in "◆⌂":
        assert [line.count(glyph) for line in bare.lines()] == [
            line.count(glyph) for line in shaded.lines()
        ]
