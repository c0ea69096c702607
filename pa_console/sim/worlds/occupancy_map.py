"""Occupancy maps of robots (ROS `map_server`: a YAML file and a PGM image) as a background.

A pixel gives the probability that its place is occupied: (255 - value) / 255, or value / 255 with
`negate`. Above `occupied_thresh`, the place is occupied; below `free_thresh`, it is free; between
them, it is unknown. The origin is the lower left corner of the image, in metres.
"""

import math
import re
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from pa_console.schema.base import Positive, Share, StrictModel
from pa_console.schema.document import Document, DocumentError
from pa_console.schema.world import (
    FREE_CELL,
    MOST_ROWS,
    OCCUPIED_CELL,
    UNKNOWN_CELL,
    Background,
)

MOST_PIXELS = 64_000_000
"""The largest number of pixels in an image; maps of laboratories have about one million."""

LEAST_TURN = 1e-3
"""The smallest rotation of a map that is taken into account, in radians."""

_TOKEN = re.compile(rb"(?:\s|#[^\n]*\n)*([^\s#]+)")


class MapFile(StrictModel):
    """The YAML file of a map."""

    image: str = Field(min_length=1, description="the PGM file, relative to this file or absolute")
    resolution: Positive = Field(description="metres per pixel")
    origin: tuple[float, float, float] = Field(description="x, y in metres, yaw in radians")
    negate: Annotated[int, Field(ge=0, le=1)] | bool = False
    occupied_thresh: Share = 0.65
    free_thresh: Share = 0.25
    mode: Literal["trinary", "scale", "raw"] = "trinary"


def read_occupancy_map(path: Path) -> Background:
    """Read the map with the YAML file `path`, reduced to at most MOST_ROWS rows and columns.

    Raises DocumentError with file, line and field.
    """
    document = Document.read(path)
    settings = document.parse(MapFile)
    if settings.mode == "raw":
        raise document.error(("mode",), "raw maps have no probabilities; save the map as trinary")
    if settings.origin[2] != 0.0:
        problem = "a rotated map cannot be shown; rotate the image, and set yaw to 0.0"
        raise document.error(("origin",), problem)
    if settings.free_thresh >= settings.occupied_thresh:
        raise document.error(("free_thresh",), "must be below occupied_thresh")
    image = path.parent / settings.image
    if image.suffix.lower() != ".pgm":
        problem = f"{settings.image}: only PGM can be read; convert it, e.g. with ImageMagick"
        raise document.error(("image",), problem)
    value = _read_pgm(image)
    occupancy = value if settings.negate else 1.0 - value
    return background_of(
        occupancy > settings.occupied_thresh,
        occupancy < settings.free_thresh,
        settings.origin[:2],
        settings.resolution,
    )


def _read_pgm(path: Path) -> npt.NDArray[np.float64]:
    """Return the pixels of a PGM image (P2 or P5) as 0.0 to 1.0, top row first."""
    try:
        data, at, header = path.read_bytes(), 0, list[bytes]()
    except OSError as error:
        raise DocumentError(str(path), 0, "", error.strerror or str(error)) from error
    while len(header) < 4 and (token := _TOKEN.match(data, at, at + 4096)):
        header.append(token.group(1))
        at = token.end()
    if len(header) < 4 or header[0] not in (b"P2", b"P5") or not b"".join(header[1:]).isdigit():
        raise DocumentError(str(path), 1, "", "this is not a PGM image (P2 or P5)")
    width, height, most = (int(token[:9]) for token in header[1:])
    if not 0 < most < 65536 or not 0 < width * height <= MOST_PIXELS:
        problem = f"an image of {width} x {height} pixels with values up to {most} cannot be read"
        raise DocumentError(str(path), 1, "", problem)
    count, body = width * height, data[at + 1 :]
    pixels: npt.NDArray[Any]
    if header[0] == b"P5":
        kind = np.dtype(np.uint8 if most < 256 else ">u2")
        there = min(count, len(body) // kind.itemsize)
        pixels = np.frombuffer(body, kind, there)
    else:
        try:
            pixels = np.array(body.split()[:count], np.float64)
        except ValueError as error:
            raise DocumentError(str(path), 2, "", "a pixel is not a number") from error
    if pixels.size < count:
        problem = f"only {pixels.size} of {count} pixels: the file was cut off"
        raise DocumentError(str(path), 2, "", problem)
    return pixels.reshape(height, width).astype(np.float64) / most


def background_of(
    occupied: npt.NDArray[np.bool_],
    free: npt.NDArray[np.bool_],
    corner: tuple[float, float],
    resolution_m: float,
    turn: float = 0.0,
) -> Background:
    """Return a background of pixel blocks; a block with an occupied pixel is occupied.

    The first row of pixels is at the top. The map is turned by `turn` radians around its lower left
    `corner`.
    """
    height, width = occupied.shape
    step = -(-max(height, width) // MOST_ROWS)
    pad = (-height % step, 0), (0, -width % step)  # the lower left corner stays where it is

    def blocks(which: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
        whole = np.pad(which, pad)
        rows, columns = whole.shape
        parts = whole.reshape(rows // step, step, columns // step, step)
        return np.asarray(parts.any(axis=(1, 3)))

    layers, cell_m = [blocks(occupied), blocks(free)], resolution_m * step
    if abs(turn) > LEAST_TURN:
        layers, corner, cell_m = _turned(layers, corner, cell_m, turn)
    glyphs = np.where(layers[0], OCCUPIED_CELL, np.where(layers[1], FREE_CELL, UNKNOWN_CELL))
    rows = tuple("".join(row) for row in glyphs.tolist())
    return Background(origin=corner, cell_m=cell_m, rows=rows)


def _turned(
    layers: list[npt.NDArray[np.bool_]], corner: tuple[float, float], cell_m: float, turn: float
) -> tuple[list[npt.NDArray[np.bool_]], tuple[float, float], float]:
    """Return layers turned around their lower left corner, the new corner, and the new cell."""
    height, width = layers[0].shape
    along, up = (
        np.array((math.cos(turn), math.sin(turn))),
        np.array((-math.sin(turn), math.cos(turn))),
    )
    ends = np.array([x * along + y * up for x in (0, width) for y in (0, height)]) * cell_m
    least, extent = ends.min(axis=0), np.ptp(ends, axis=0)
    # Cells that are √2 as wide leave no gaps, however the map is turned.
    wide_m = max(math.sqrt(2) * cell_m, float(extent.max()) / (MOST_ROWS - 1))
    columns, rows = (int(number) + 1 for number in extent // wide_m)

    def laid(which: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
        row, column = np.nonzero(which)
        at = np.outer(column + 0.5, along) + np.outer(height - row - 0.5, up)
        x, y = ((at * cell_m - least) // wide_m).astype(np.int64).T
        grid = np.zeros((rows, columns), np.bool_)
        grid[rows - 1 - y, x] = True
        return grid

    origin = corner[0] + float(least[0]), corner[1] + float(least[1])
    return [laid(which) for which in layers], origin, wide_m
