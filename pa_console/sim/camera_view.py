"""A camera's image of a contact, drawn from the simulated scene; equal scenes give equal images.

The camera turns to the contact and zooms in. A vehicle's colour and plate follow from its id and
the seed alone, so they are the same in every image of a session. Only the rain varies with the
tick.
"""

import hashlib
import math
import random
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from io import BytesIO
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

from pa_console.schema.base import Point
from pa_console.schema.telemetry import Weather
from pa_console.schema.world import AssetKind
from pa_console.sim.scene import Scene
from pa_console.sim.sensing_state import ContactKind, ContactState
from pa_console.sim.worlds.terrain import Terrain

if TYPE_CHECKING:
    from PIL.ImageDraw import ImageDraw

Rgb = tuple[int, int, int]
Place = tuple[float, float, float]
"""A position in metres: x, y, height."""

SIZE = 640, 400
"""Width and height of an image in pixels."""
_ACROSS_M: dict[ContactKind, float] = {"vehicle": 7.0, "person": 4.0}
"""The width in metres that is visible at the contact's distance."""
_MAST_M, _AIM_M, _NEAREST_M = 4.0, 0.9, 0.5
_COLOURS: dict[str, Rgb] = {
    "white": (232, 232, 228), "black": (38, 38, 42), "silver": (168, 172, 178),
    "red": (176, 32, 36), "blue": (36, 76, 160), "green": (38, 110, 62),
    "yellow": (226, 184, 40), "brown": (112, 76, 48),
}  # fmt: skip
_LETTERS = "ABCDEFGHJKLMNPRSTUVWXYZ"
_ASSETS: dict[AssetKind, tuple[Place, float, Rgb]] = {
    "uav": ((0.8, 0.8, 0.2), 5.0, (60, 62, 66)),
    "ugv": ((2.2, 1.4, 1.0), 0.0, (92, 104, 70)),
    "robot": ((0.8, 0.6, 1.2), 0.0, (214, 120, 32)),
}
"""For each kind of asset: its length, width and height, its height above ground, its colour."""
_FOG: dict[Weather, float] = {"clear": 0.0, "rain": 0.15, "fog": 0.5}


class Look(NamedTuple):
    """The appearance of a vehicle: the name of its colour, and its plate."""

    colour: str
    plate: str


def look_of(contact: str, seed: int) -> Look:
    """Return a contact's appearance, which follows from its id and the session's seed."""
    drawn = random.Random(hashlib.sha256(f"{seed}/{contact}".encode()).digest())
    letters = "".join(drawn.choice(_LETTERS) for _ in range(3))
    return Look(drawn.choice(list(_COLOURS)), f"{letters} {drawn.randrange(1000):03d}")


def still_of(
    terrain: Terrain, scene: Scene, seed: int, camera: str, track: str
) -> Callable[[], bytes] | None:
    """Return a function, for any thread, that draws the present image of `track` as a PNG file.

    Returns None if `camera` does not work or there is no such track.
    """
    file = next((file for file in scene.sensing.files.values() if file.id == track), None)
    contact = scene.contacts.get(file.contact) if file is not None else None
    if contact is None or camera in scene.sensing.broken:
        return None
    eye = _Eye(terrain.world.cameras[camera].at, contact.position, _ACROSS_M[contact.kind])
    shapes = sorted(_shapes(terrain, scene, seed), key=eye.depth_of, reverse=True)
    lanes = [lane.points for lane in terrain.world.lanes.values()]
    return partial(_drawn, eye, lanes, shapes, scene.sensing.weather, scene.tick)


def _drawn(
    eye: "_Eye",
    lanes: Sequence[Sequence[Point]],
    shapes: "Sequence[_Box | _Person]",
    weather: Weather,
    tick: int,
) -> bytes:
    from PIL import Image, ImageDraw  # noqa: PLC0415 - only if an image is drawn

    image = Image.new("RGB", SIZE, (164, 186, 206))
    canvas = ImageDraw.Draw(image)
    if eye.horizon < SIZE[1]:
        canvas.rectangle((0, max(eye.horizon, 0), *SIZE), fill=(122, 126, 104))
    for points in lanes:
        for strip in _road(points):
            eye.fill(canvas, strip, (96, 98, 100))
    for shape in shapes:
        shape.draw(canvas, eye)
    image = Image.blend(image, Image.new("RGB", SIZE, (176, 180, 184)), _FOG[weather])
    if weather == "rain":
        _rain(ImageDraw.Draw(image), random.Random(tick))
    buffer = BytesIO()
    image.save(buffer, "PNG")
    return buffer.getvalue()


class _Eye:
    """A camera on its mast, aimed at a point; it projects positions into the image."""

    def __init__(self, at: Point, target: Point, across_m: float) -> None:
        self._at = at
        away = max(math.dist(at, target), 1.0)
        self._ahead = ((target[0] - at[0]) / away, (target[1] - at[1]) / away)
        down = math.atan2(_MAST_M - _AIM_M, away)
        self._cos, self._sin = math.cos(down), math.sin(down)
        self._focal = SIZE[0] * math.hypot(away, _MAST_M - _AIM_M) / across_m
        self.horizon = round(SIZE[1] / 2 - self._focal * math.tan(down))
        """The row of pixels at the horizon; it may be above the image."""

    def depth(self, place: Place) -> float:
        """Return the distance from the camera to a position along the viewing direction."""
        east, north = place[0] - self._at[0], place[1] - self._at[1]
        along = east * self._ahead[0] + north * self._ahead[1]
        return along * self._cos + (_MAST_M - place[2]) * self._sin

    def depth_of(self, shape: "_Box | _Person") -> float:
        """Return the distance from the camera to a shape's centre along the viewing direction."""
        return self.depth((*shape.at, 0.0))

    def see(self, place: Place) -> tuple[float, float]:
        """Return the pixel of a position in front of the camera."""
        east, north = place[0] - self._at[0], place[1] - self._at[1]
        along = east * self._ahead[0] + north * self._ahead[1]
        right = east * self._ahead[1] - north * self._ahead[0]
        below = (_MAST_M - place[2]) * self._cos - along * self._sin
        scale = self._focal / self.depth(place)
        return SIZE[0] / 2 + right * scale, SIZE[1] / 2 + below * scale

    def fill(self, canvas: "ImageDraw", corners: Sequence[Place], colour: Rgb) -> bool:
        """Fill a face if all its corners are in front of the camera; return whether they are."""
        if any(self.depth(corner) < _NEAREST_M for corner in corners):
            return False
        canvas.polygon([self.see(corner) for corner in corners], fill=colour)
        return True


class _Box(NamedTuple):
    """A box, turned to `heading`, with its bottom `base` metres above the ground.

    Its ends show `plate`; the boxes `above` are on top of it.
    """

    at: Point
    heading: float
    size: Place
    base: float
    colour: Rgb
    plate: str = ""
    above: "tuple[_Box, ...]" = ()

    def corner(self, along: float, aside: float, up: float) -> Place:
        """Return a corner: `along` and `aside` are -1 or 1, `up` is 0 (bottom) or 1 (top)."""
        x, y = along * self.size[0] / 2, aside * self.size[1] / 2
        cos, sin = math.cos(self.heading), math.sin(self.heading)
        return (
            self.at[0] + x * cos - y * sin,
            self.at[1] + x * sin + y * cos,
            self.base + up * self.size[2],
        )

    def draw(self, canvas: "ImageDraw", eye: _Eye) -> None:
        """Draw the faces from far to near, so that near faces cover far ones."""
        ends, top = ((-1, -1), (-1, 1), (1, 1), (1, -1)), self.corner
        faces = [
            ([top(*a, 0), top(*b, 0), top(*b, 1), top(*a, 1)], shade, end)
            for a, b, shade, end in (
                (ends[0], ends[1], 0.7, -1), (ends[1], ends[2], 0.85, 0),
                (ends[2], ends[3], 0.75, 1), (ends[3], ends[0], 0.6, 0),
            )
        ]  # fmt: skip
        faces.sort(key=lambda face: sum(map(eye.depth, face[0])), reverse=True)
        for corners, shade, end in faces:
            seen = eye.fill(canvas, corners, _shaded(self.colour, shade))
            near = end and eye.depth(top(end, 0, 0)) < eye.depth(top(0, 0, 0))
            if seen and near and self.plate:
                self._draw_plate(canvas, eye, end)
        eye.fill(canvas, [top(*end, 1) for end in ends], self.colour)
        for other in self.above:
            other.draw(canvas, eye)

    def _draw_plate(self, canvas: "ImageDraw", eye: _Eye, end: int) -> None:
        from PIL import ImageFont  # noqa: PLC0415 - only if an image is drawn

        out, half, low, high = end * 1.01, 0.55, 0.3, 0.62
        sides = ((-half, low), (half, low), (half, high), (-half, high))
        corners = [self.corner(out, aside, up) for aside, up in sides]
        eye.fill(canvas, corners, (246, 244, 226))
        left, right = sorted((eye.see(corners[0])[0], eye.see(corners[1])[0]))
        middle = eye.see(self.corner(out, 0, (low + high) / 2))
        font = ImageFont.load_default((right - left) / 5)
        canvas.text(middle, self.plate, fill=(16, 16, 20), font=font, anchor="mm")


class _Person(NamedTuple):
    """A standing person: legs, body and head."""

    at: Point
    colour: Rgb

    def draw(self, canvas: "ImageDraw", eye: _Eye) -> None:
        """Draw the figure, facing the camera."""
        if eye.depth((*self.at, 0.0)) < _NEAREST_M:
            return
        for low, high, wide, colour in (
            (0.0, 0.85, 0.34, (44, 48, 64)),
            (0.8, 1.5, 0.5, self.colour),
            (1.5, 1.78, 0.22, (206, 164, 132)),
        ):
            x, top = eye.see((*self.at, high))
            bottom = eye.see((*self.at, low))[1]
            half = wide * (bottom - top) / (high - low) / 2
            canvas.rounded_rectangle((x - half, top, x + half, bottom), half / 2, fill=colour)


def _shapes(terrain: Terrain, scene: Scene, seed: int) -> Iterator[_Box | _Person]:
    """Yield every wall, asset, vehicle and person of the scene."""
    for wall in terrain.world.walls:
        (x1, y1), (x2, y2) = wall.start, wall.end
        size = (math.dist(wall.start, wall.end), wall.thickness_m, 2.4)
        middle, heading = ((x1 + x2) / 2, (y1 + y2) / 2), math.atan2(y2 - y1, x2 - x1)
        yield _Box(middle, heading, size, 0.0, (150, 144, 134))
    for asset in scene.assets.values():
        size, base, colour = _ASSETS[asset.kind]
        yield _Box(asset.position, asset.heading, size, base, colour)
    for contact in scene.contacts.values():
        look = look_of(contact.id, seed)
        if contact.kind == "person":
            yield _Person(contact.position, _COLOURS[look.colour])
        else:
            yield _vehicle(contact, look)


def _vehicle(contact: ContactState, look: Look) -> _Box:
    """Return a vehicle's body and cabin; an emergency vehicle is white and has a blue light."""
    colour = _COLOURS["white" if contact.emergency else look.colour]
    at, heading = contact.position, contact.heading
    above = [_Box(at, heading, (2.2, 1.6, 0.6), 1.2, (52, 64, 78))]
    if contact.emergency:
        above.append(_Box(at, heading, (0.3, 1.2, 0.2), 1.8, (40, 90, 240)))
    return _Box(at, heading, (4.4, 1.8, 0.95), 0.25, colour, look.plate, tuple(above))


def _road(points: Sequence[Point], half_m: float = 3.5) -> Iterator[list[Place]]:
    """Yield a lane in short strips, so that those in front of the camera can be drawn."""
    for (x1, y1), (x2, y2) in pairwise(points):
        length = math.dist((x1, y1), (x2, y2)) or 1.0
        aside = -(y2 - y1) / length * half_m, (x2 - x1) / length * half_m
        steps = max(int(length / 2.0), 1)
        for step in range(steps):
            near, far = step / steps, (step + 1) / steps
            a = x1 + (x2 - x1) * near, y1 + (y2 - y1) * near
            b = x1 + (x2 - x1) * far, y1 + (y2 - y1) * far
            yield [
                (a[0] + aside[0], a[1] + aside[1], 0.0), (b[0] + aside[0], b[1] + aside[1], 0.0),
                (b[0] - aside[0], b[1] - aside[1], 0.0), (a[0] - aside[0], a[1] - aside[1], 0.0),
            ]  # fmt: skip


def _rain(canvas: "ImageDraw", drawn: random.Random) -> None:
    for _ in range(120):
        x, y = drawn.randrange(SIZE[0]), drawn.randrange(SIZE[1])
        canvas.line((x, y, x - 5, y + 18), fill=(206, 212, 220))


def _shaded(colour: Rgb, share: float) -> Rgb:
    return (round(colour[0] * share), round(colour[1] * share), round(colour[2] * share))
