"""The image of a camera that streams over RTSP, from a server of the test's own."""

import asyncio
import socket
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from functools import cache
from io import BytesIO
from typing import Any

import pytest
from PIL import Image

from pa_console.fleets.snapshot import SnapshotError, fetch_snapshot

av: Any = pytest.importorskip("av", reason="PyAV is not here: pip install 'pa-console[camera]'")
SIZE, FRAMES = (320, 192), 40
SDP = (
    "v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=camera\r\nt=0 0\r\n"
    "m=video 0 RTP/AVP 96\r\na=rtpmap:96 MP4V-ES/90000\r\na=control:video\r\n"
)
ANSWERS = {
    "OPTIONS": "Public: DESCRIBE, SETUP, PLAY\r\n\r\n",
    "DESCRIBE": f"Content-Type: application/sdp\r\nContent-Length: {len(SDP)}\r\n\r\n{SDP}",
    "SETUP": "Transport: RTP/AVP/TCP;unicast;interleaved=0-1\r\nSession: 1\r\n\r\n",
}


@cache
def packets() -> tuple[bytes, ...]:
    """Return a stream of grey images as RTP packets."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as inbox:
        inbox.bind(("127.0.0.1", 0))
        inbox.settimeout(1.0)
        port = inbox.getsockname()[1]
        taken: list[bytes] = []
        with av.open(f"rtp://127.0.0.1:{port}", "w", format="rtp") as output:
            stream = output.add_stream("mpeg4", rate=20)
            (stream.width, stream.height), stream.pix_fmt = SIZE, "yuv420p"
            for _ in range(FRAMES):
                frame = av.VideoFrame.from_image(Image.new("RGB", SIZE, (200, 200, 200)))
                output.mux(stream.encode(frame))
            output.mux(stream.encode())
            while len(taken) < FRAMES:
                taken.append(inbox.recv(65536))
    return tuple(taken)


@asynccontextmanager
async def camera(content: bytes | None = None) -> AsyncGenerator[str]:
    """Serve the stream, or `content` in its place: nothing for b""."""

    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            while content is None:
                request = (await reader.readuntil(b"\r\n\r\n")).decode().splitlines()
                number = next(line for line in request if line.startswith("CSeq"))
                method = request[0].partition(" ")[0]
                answered = ANSWERS.get(method, "Session: 1\r\n\r\n")
                writer.write(f"RTSP/1.0 200 OK\r\n{number}\r\n{answered}".encode())
                for packet in packets() if method == "PLAY" else ():
                    writer.write(b"$\0" + len(packet).to_bytes(2, "big") + packet)
                if method == "PLAY":
                    break
            writer.write(content or b"")
            await writer.drain()
            await reader.read()
        except (ConnectionError, EOFError, asyncio.CancelledError):
            pass
        finally:
            writer.close()

    server = await asyncio.start_server(answer, "127.0.0.1", 0)
    async with server:
        yield f"rtsp://user:secret@127.0.0.1:{server.sockets[0].getsockname()[1]}/live"


async def test_an_image_of_the_stream_is_taken() -> None:
    async with camera() as url:
        taken = await fetch_snapshot(url, 60.0)
    with Image.open(BytesIO(taken)) as image:
        assert (image.format, image.size) == ("JPEG", SIZE)
        assert image.getpixel((100, 100)) == pytest.approx((200, 200, 200), abs=8)


@pytest.mark.parametrize("content", [b"HTTP/1.1 404 Not Found\r\n\r\n", bytes(100_000), b""])
async def test_what_is_no_stream_is_refused_in_words(content: bytes) -> None:
    async with camera(content) as url:
        with pytest.raises(SnapshotError, match=r"streams no|no answer within") as refused:
            await fetch_snapshot(url, 1.0)
    assert "secret" not in str(refused.value)


async def test_an_address_at_which_nobody_is() -> None:
    with pytest.raises(SnapshotError, match="streams no video"):
        await fetch_snapshot("rtsp://127.0.0.1:1/live", 30.0)
