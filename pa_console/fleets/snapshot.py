"""Snapshots of a camera, fetched from its address within limits and re-encoded for safety.

A camera may be slow, send without end, or send something that is not an image. The image is
decoded and encoded again here, so that none of the camera's own bytes reach a screen, a browser or
the log's folder.
"""

import asyncio
import ssl
import warnings
from importlib import import_module
from io import BytesIO
from time import monotonic
from typing import TYPE_CHECKING, Any

from pa_console.resources import install_hint, missing_library

if TYPE_CHECKING:
    from PIL.Image import Image

MOST_S, MOST_BYTES, MOST_PIXELS = 5.0, 4_000_000, 24_000_000
"""The longest wait in seconds, the largest file in bytes, and the largest image in pixels."""
MOST_SIDE = 800
"""The longest side of the resulting image, in pixels."""
_STREAMING = {
    "rtsp_transport": "tcp", "protocol_whitelist": "rtsp,rtp,tcp,udp", "analyzeduration": "1000000",
}  # fmt: skip
"""The options of FFmpeg for a stream: transport, protocols, and the time to analyse it in µs."""


class SnapshotError(Exception):
    """Raised with words for the operator if there is no image.

    The words leave out the address, which may contain a password.
    """


async def fetch_snapshot(url: str, limit_s: float = MOST_S) -> bytes:
    """Return the image at `url` as JPEG; raises SnapshotError on failure or after `limit_s`."""
    try:
        async with asyncio.timeout(limit_s):
            if url.startswith("rtsp:"):
                return await asyncio.to_thread(_frame_of, url, limit_s)
            verify = await asyncio.to_thread(_load, url)
            return await asyncio.to_thread(safe_image, await _content(url, verify))
    except TimeoutError:
        raise SnapshotError(f"no answer within {limit_s:g} s") from None


def _frame_of(url: str, limit_s: float) -> bytes:
    """Return the first complete image of the stream at `url`; raises SnapshotError on failure."""
    try:
        av: Any = import_module("av")
    except ModuleNotFoundError:
        raise SnapshotError(f"streams, which needs PyAV: {install_hint('camera')}") from None
    until_s, size = monotonic() + limit_s, 0
    try:
        with av.open(url, options=_STREAMING, timeout=limit_s) as stream:
            video = stream.streams.video[0]
            video.codec_context.options = {"max_pixels": str(MOST_PIXELS)}
            for packet in stream.demux(video):
                size += packet.size
                if size > MOST_BYTES or monotonic() > until_s:
                    break
                for frame in packet.decode():
                    if not frame.is_corrupt:
                        return _encoded(frame.to_image())
    except (av.FFmpegError, IndexError, OSError, ValueError) as error:
        raise SnapshotError(f"streams no video ({type(error).__name__})") from None
    raise SnapshotError("streams no readable image")


def _load(url: str) -> ssl.SSLContext | bool:
    """Import the HTTP library, which takes a moment; return the TLS context, or False for HTTP."""
    if missing := missing_library("httpx2", "camera", "a camera with an address needs"):
        raise SnapshotError(missing)
    import_module("httpx2")
    return url.startswith("https:") and ssl.create_default_context()


async def _content(url: str, verify: ssl.SSLContext | bool) -> bytes:
    """Return the content at `url`, not decompressed; raises SnapshotError if it is too large."""
    import httpx2  # noqa: PLC0415 - needed only if a camera has an address

    content = bytearray()
    plain = {"Accept-Encoding": "identity"}
    try:
        async with (
            httpx2.AsyncClient(
                trust_env=False, follow_redirects=False, verify=verify, timeout=None
            ) as client,
            client.stream("GET", url, headers=plain) as answer,
        ):
            if answer.status_code != 200:
                raise SnapshotError(f"answered {answer.status_code}")
            async for piece in answer.aiter_raw():
                content += piece
                if len(content) > MOST_BYTES:
                    raise SnapshotError(f"sends more than {MOST_BYTES // 1_000_000} MB")
    except (httpx2.HTTPError, httpx2.InvalidURL, OSError) as error:
        raise SnapshotError(f"cannot be reached ({type(error).__name__})") from None
    return bytes(content)


def safe_image(content: bytes) -> bytes:
    """Return an image, encoded again as JPEG with sides of at most MOST_SIDE pixels.

    Raises SnapshotError unless `content` is a JPEG or PNG of at most MOST_PIXELS.
    """
    from PIL import Image  # noqa: PLC0415 - needed only if an image is taken

    # A large image is refused below. The warning would be written on the screen before that.
    warnings.simplefilter("ignore", Image.DecompressionBombWarning)
    try:
        with Image.open(BytesIO(content), formats=("JPEG", "PNG")) as image:
            if image.width * image.height > MOST_PIXELS:
                raise SnapshotError(f"sends too large an image: {image.width} × {image.height}")
            image.draft("RGB", (MOST_SIDE, MOST_SIDE))
            return _encoded(image)
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise SnapshotError("sends no readable image (JPEG or PNG)") from error


def _encoded(image: "Image") -> bytes:
    """Return an image as JPEG with sides of at most MOST_SIDE pixels."""
    image.thumbnail((MOST_SIDE, MOST_SIDE))
    buffer = BytesIO()
    image.convert("RGB").save(buffer, "JPEG", quality=85)
    return buffer.getvalue()
