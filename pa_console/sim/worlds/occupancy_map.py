"""Occupancy maps of robots (ROS `map_server`: a YAML file and a PGM image) as a background.

A pixel is the probability that its place is occupied: (255 - value) / 255, or value / 255 with
`negate`. Above `occupied_thresh` the place is occupied, below `free_thresh` it is free, between
them unknown. The origin is the lower left corner of the image, in metres.
"""

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

_TOKEN = re.compile(rb"(?:\s|#[^\n]*\n)*([^\s#]+)")


class MapFile(StrictModel):
    """The YAML file of a map."""

    image: str = Field(min_length=1, description="the PGM file, beside this one unless absolute")
    resolution: Positive = Field(description="metres a pixel")
    origin: tuple[float, float, float] = Field(description="x, y in metres, yaw in radians")
    negate: Annotated[int, Field(ge=0, le=1)] | bool = False
    occupied_thresh: Share = 0.65
    free_thresh: Share = 0.25
    mode: Literal["trinary", "scale", "raw"] = "trinary"


def read_occupancy_map(path: Path) -> Background:
    """Read the map with the YAML file `path`, with at most MOST_ROWS rows and columns.

    Raises DocumentError with file, line and field.
    """
    document = Document.read(path)
    found = document.parse(MapFile)
    if found.mode == "raw":
        raise document.error(("mode",), "raw maps have no probabilities; save the map as trinary")
    if found.origin[2] != 0.0:
        problem = "a turned map cannot be shown; turn the image, and give yaw 0.0"
        raise document.error(("origin",), problem)
    if found.free_thresh >= found.occupied_thresh:
        raise document.error(("free_thresh",), "must be below occupied_thresh")
    image = path.parent / found.image
    if image.suffix.lower() != ".pgm":
        problem = f"{found.image}: only PGM is read; convert it, such as with ImageMagick"
        raise document.error(("image",), problem)
    value = _read_pgm(image)
    occupancy = value if found.negate else 1.0 - value
    return _background(
        occupancy > found.occupied_thresh,
        occupancy < found.free_thresh,
        found.origin[:2],
        found.resolution,
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
        raise DocumentError(str(path), 1, "", "this is no PGM image (P2 or P5)")
    width, height, most = (int(token[:9]) for token in header[1:])
    if not 0 < most < 65536 or not 0 < width * height <= MOST_PIXELS:
        problem = f"a size of {width} x {height} pixels up to {most} is not read"
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
            raise DocumentError(str(path), 2, "", "a pixel is no number") from error
    if pixels.size < count:
        problem = f"{pixels.size} of {count} pixels: the file was cut off"
        raise DocumentError(str(path), 2, "", problem)
    return pixels.reshape(height, width).astype(np.float64) / most


def _background(
    occupied: npt.NDArray[np.bool_],
    free: npt.NDArray[np.bool_],
    origin: tuple[float, float],
    resolution_m: float,
) -> Background:
    """Return a background of pixel blocks; a block with an occupied pixel is occupied."""
    height, width = occupied.shape
    step = -(-max(height, width) // MOST_ROWS)
    pad = (-height % step, 0), (0, -width % step)  # the lower left corner stays where it is

    def blocks(which: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
        whole = np.pad(which, pad)
        rows, columns = whole.shape
        parts = whole.reshape(rows // step, step, columns // step, step)
        return np.asarray(parts.any(axis=(1, 3)))

    glyphs = np.where(
        blocks(occupied), OCCUPIED_CELL, np.where(blocks(free), FREE_CELL, UNKNOWN_CELL)
    )
    return Background(
        origin=origin,
        cell_m=resolution_m * step,
        rows=tuple("".join(row) for row in glyphs.tolist()),
    )
