"""`python -m tests.attacks.loads KIND HOST PORT`: what strangers on this machine do to a service.

None has a token that may command. Each kind goes on until its process is ended.
"""

import asyncio
import random
import sys
from collections.abc import Awaitable, Callable
from contextlib import suppress

CONNECTIONS = 500
WORKERS = 50
LARGE = 10 << 20
PIECE = 1 << 16
Address = tuple[str, int]
Streams = tuple[asyncio.StreamReader, asyncio.StreamWriter]


def request(address: Address, method: str, path: str, *headers: str, host: str = "") -> bytes:
    """Return the head of a request."""
    lines = (f"{method} {path} HTTP/1.1", f"Host: {host or f'{address[0]}:{address[1]}'}", *headers)
    return "\r\n".join((*lines, "", "")).encode()


async def idle(address: Address) -> None:
    """Hold a connection and ask for nothing; connect again as soon as it is closed."""
    reader, _ = await asyncio.open_connection(*address)
    await reader.read()


async def slow(address: Address) -> None:
    """Send a body of an allowed length, one byte a second."""
    _, writer = await asyncio.open_connection(*address)
    writer.write(request(address, "POST", "/v1/missions", "Content-Length: 60000"))
    while not writer.is_closing():
        writer.write(b"x")
        await writer.drain()
        await asyncio.sleep(1.0)


async def large(address: Address) -> None:
    """Send 10 MB, with its length said beforehand or in pieces."""
    reader, writer = await asyncio.open_connection(*address)
    chunked = random.random() < 0.5
    length = "Transfer-Encoding: chunked" if chunked else f"Content-Length: {LARGE}"
    path = random.choice(("/v1/missions", "/mcp", "/v1/decisions"))
    writer.write(request(address, "POST", path, length, "Content-Type: application/json"))
    piece = b" " * PIECE
    for _ in range(LARGE // PIECE):
        writer.write(b"%x\r\n%b\r\n" % (PIECE, piece) if chunked else piece)
        await writer.drain()
    await reader.read(PIECE)
    writer.close()


async def names(address: Address) -> None:
    """Ask in another name, or for a page of another site."""
    host = random.choice(("evil.example", f"evil.example:{address[1]}", "127.0.0.1:1", ""))
    origin = random.choice(("Origin: http://evil.example", "Origin: null"))
    reader, writer = await asyncio.open_connection(*address)
    for _ in range(20):
        writer.write(request(address, "POST", "/v1/stop", origin, "Content-Length: 0", host=host))
        await writer.drain()
        await reader.readuntil(b"\r\n\r\n")
    writer.close()


async def tokens(address: Address) -> None:
    """Guess tokens, for a stop, a release, a decision and the events."""
    reader, writer = await asyncio.open_connection(*address)
    for path in ("/v1/stop", "/v1/release", "/v1/decisions", "/mcp"):
        token = f"Authorization: Bearer pa_{random.randbytes(32).hex()}"
        writer.write(request(address, "POST", path, token, "Content-Length: 0"))
        await writer.drain()
        await reader.readuntil(b"\r\n\r\n")
    writer.close()


KINDS: dict[str, tuple[Callable[[Address], Awaitable[None]], int]] = {
    "idle": (idle, CONNECTIONS),
    "slow": (slow, CONNECTIONS),
    "large": (large, WORKERS),
    "names": (names, WORKERS),
    "tokens": (tokens, WORKERS),
}
"""Each kind of load, and how many do so at once."""


async def again(act: Callable[[Address], Awaitable[None]], address: Address) -> None:
    """Do it again and again."""
    while True:
        with suppress(OSError, EOFError, ValueError):
            await act(address)
        await asyncio.sleep(0.01)


async def main() -> None:
    """Go on with one kind of load; say so once every connection was tried."""
    kind, host, port = sys.argv[1:]
    act, times = KINDS[kind]
    work = [asyncio.create_task(again(act, (host, int(port)))) for _ in range(times)]
    await asyncio.sleep(0.5)
    print("under way", flush=True)
    await asyncio.gather(*work)


if __name__ == "__main__":
    asyncio.run(main())
