"""A camera's picture from its address: whatever is there, it takes a limited time and room."""

import asyncio
import struct
import zlib
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import asynccontextmanager
from io import BytesIO

import pytest
from PIL import Image

from pa_console.fleets import snapshot
from pa_console.fleets.snapshot import MOST_SIDE, SnapshotError, fetch_snapshot, safe_image
from pa_console.schema.world import World
from pa_console.sim.worlds.world_file import open_world
from tests.stills import CAMERA

Serve = Callable[[asyncio.StreamWriter], Awaitable[None]]


def encoded(kind: str, size: tuple[int, int] = (64, 40), mode: str = "RGB") -> bytes:
    """Return a plain picture."""
    buffer = BytesIO()
    Image.new(mode, size, 200).save(buffer, kind)
    return buffer.getvalue()


@asynccontextmanager
async def camera(serve: Serve) -> AsyncGenerator[str]:
    """Serve one answer to each request."""

    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            await reader.readuntil(b"\r\n\r\n")
            await serve(writer)
        except (ConnectionError, EOFError, asyncio.CancelledError):
            pass
        finally:
            writer.close()

    server = await asyncio.start_server(answer, "127.0.0.1", 0)
    async with server:
        yield f"http://user:secret@127.0.0.1:{server.sockets[0].getsockname()[1]}/snapshot.jpg"


def sends(content: bytes, status: str = "200 OK", more: str = "") -> Serve:
    """Return what sends `content`."""

    async def serve(writer: asyncio.StreamWriter) -> None:
        head = f"HTTP/1.1 {status}\r\nContent-Length: {len(content)}\r\n{more}\r\n"
        writer.write(head.encode() + content)
        await writer.drain()

    return serve


async def sends_without_end(writer: asyncio.StreamWriter) -> None:
    writer.write(b"HTTP/1.1 200 OK\r\n\r\n")
    while True:
        writer.write(bytes(65536))
        await writer.drain()


async def hangs(writer: asyncio.StreamWriter) -> None:
    writer.write(b"HTTP/1.1 200 OK\r\nContent-Length: 100\r\n\r\n")
    await asyncio.Event().wait()


@pytest.mark.parametrize("kind", ["JPEG", "PNG"])
async def test_a_picture_is_taken_and_written_anew(kind: str) -> None:
    sent = encoded(kind, (1600, 900)) + b"<script>"
    async with camera(sends(sent)) as url:
        taken = await fetch_snapshot(url)
    with Image.open(BytesIO(taken)) as image:
        assert (image.format, image.size) == ("JPEG", (MOST_SIDE, 450))
    assert b"<script>" not in taken


@pytest.mark.parametrize(
    ("serve", "why"),
    [
        (sends(b"<html>log in</html>"), "sends no readable image"),
        (sends(encoded("GIF")), "sends no readable image"),
        (sends(encoded("JPEG")[:300]), "sends no readable image"),
        (sends(b""), "sends no readable image"),
        (sends(b"", "401 Unauthorized"), "answered 401"),
        (sends(b"", "302 Found", "Location: http://127.0.0.1:1/\r\n"), "answered 302"),
        (sends_without_end, "sends more than 4 MB"),
    ],
)
async def test_what_is_no_picture_is_refused_in_words(serve: Serve, why: str) -> None:
    async with camera(serve) as url:
        with pytest.raises(SnapshotError, match=why) as refused:
            await fetch_snapshot(url)
    assert "secret" not in str(refused.value)


async def test_an_answer_that_does_not_end_is_given_up() -> None:
    async with camera(hangs) as url:
        with pytest.raises(SnapshotError, match=r"no answer within 0\.2 s"):
            await fetch_snapshot(url, 0.2)


async def test_an_address_at_which_nobody_is() -> None:
    with pytest.raises(SnapshotError, match="cannot be reached"):
        await fetch_snapshot("http://127.0.0.1:1/x.jpg")


@pytest.mark.parametrize(
    "url", ["ftp://10.0.0.7/x", "file:///etc/passwd", "http://", "http://[", "ros2:x", "ros2:/a b"]
)
def test_a_world_file_takes_addresses_of_images_alone(url: str) -> None:
    site = open_world("checkpoint")[0].model_dump()
    for good in ("http://10.0.0.7:8080/snapshot.jpg", "rtsp://10.0.0.7/live", "ros2:/gate/image"):
        site["cameras"][CAMERA]["snapshot"] = good
        assert World.model_validate(site).cameras[CAMERA].snapshot == good
    site["cameras"][CAMERA]["snapshot"] = url
    with pytest.raises(ValueError, match=f"cameras.{CAMERA}.snapshot"):
        World.model_validate(site)


def bomb(side: int) -> bytes:
    """Return a PNG that claims `side` pixels each way and has next to no data."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    head = struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)
    body = zlib.compress(bytes(1_000_000))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", body) + chunk(b"IEND", b"")


@pytest.mark.parametrize("side", [6000, 12_000, 60_000])
def test_an_image_that_would_fill_the_memory_is_not_unpacked(
    side: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded: list[object] = []
    monkeypatch.setattr(Image.Image, "load", loaded.append)
    with pytest.raises(SnapshotError, match=r"sends (too large an|no readable) image"):
        safe_image(bomb(side))
    assert not loaded


def test_every_kind_of_pixel_becomes_a_picture() -> None:
    for mode in ("L", "P", "RGBA", "1", "I;16"):
        assert safe_image(encoded("PNG", mode=mode)).startswith(b"\xff\xd8")
    assert (Image.MAX_IMAGE_PIXELS or 0) > snapshot.MOST_PIXELS
