"""Fetches a camera's picture from its address, within limits, and makes a safe image of it.

A camera may be slow, send without end, or send something else than a picture. What is handed on
has been decoded here and written anew, so nothing of the camera's own bytes reaches a screen, a
browser or the log's folder.
"""

import asyncio
import ssl
import warnings
from importlib import import_module
from io import BytesIO

MOST_S, MOST_BYTES, MOST_PIXELS = 5.0, 4_000_000, 24_000_000
"""The longest wait, and the largest file and picture that are taken."""
MOST_SIDE = 800
"""Pixels of the longer side of what is kept."""


class SnapshotError(Exception):
    """No picture, in words for the operator; the address is left out, it may hold a password."""


async def fetch_snapshot(url: str, limit_s: float = MOST_S) -> bytes:
    """Return the picture at `url` as JPEG within `limit_s` seconds; raises SnapshotError."""
    try:
        async with asyncio.timeout(limit_s):
            verify = await asyncio.to_thread(_load, url)
            return await asyncio.to_thread(safe_image, await _content(url, verify))
    except TimeoutError:
        raise SnapshotError(f"no answer within {limit_s:g} s") from None


def _load(url: str) -> ssl.SSLContext | bool:
    """Load the library, which takes a moment; return what certificates are checked with."""
    import_module("httpx2")
    return url.startswith("https:") and ssl.create_default_context()


async def _content(url: str, verify: ssl.SSLContext | bool) -> bytes:
    """Return what is at `url`, not unpacked; the reading ends where it is too much."""
    import httpx2  # noqa: PLC0415 - only where a camera has an address

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
    """Return a picture written anew as JPEG of at most MOST_SIDE pixels; raises SnapshotError.

    Only JPEG and PNG are read, of at most MOST_PIXELS.
    """
    from PIL import Image  # noqa: PLC0415 - only where a picture is taken

    # A large picture is refused below; nothing is to be written on the screen before.
    warnings.simplefilter("ignore", Image.DecompressionBombWarning)
    try:
        with Image.open(BytesIO(content), formats=("JPEG", "PNG")) as image:
            if image.width * image.height > MOST_PIXELS:
                raise SnapshotError(f"sends too large a picture: {image.width} × {image.height}")
            image.draft("RGB", (MOST_SIDE, MOST_SIDE))
            image.thumbnail((MOST_SIDE, MOST_SIDE))
            buffer = BytesIO()
            image.convert("RGB").save(buffer, "JPEG", quality=85)
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise SnapshotError("sends no picture that can be read (JPEG or PNG)") from error
    return buffer.getvalue()
