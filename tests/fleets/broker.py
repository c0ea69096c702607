"""A broker for tests: Mosquitto where it is installed, else the one of our own process."""

import asyncio
import shutil
import socket
import subprocess
import tempfile
import threading
import time
from contextlib import AbstractContextManager
from pathlib import Path
from random import Random
from typing import Protocol, Self

import pytest

from pa_console.fleets.vda5050.broker import LOOPBACK, BrokerAddress, run_broker

UP_S = 120.0


def mosquitto() -> str | None:
    """Return the path of Mosquitto, None where it is not installed."""
    return shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")


def free_port() -> int:
    with socket.socket() as found:
        found.bind((LOOPBACK, 0))
        return found.getsockname()[1]


class Broker(Protocol):
    """A broker that can be killed, and started again on the same port."""

    port: int

    def start(self) -> None:
        """Let it listen."""
        ...

    def kill(self) -> None:
        """End it at once."""
        ...


class Mosquitto:
    """Mosquitto as a process of the test's own, without certificates."""

    def __init__(self, port: int = 0) -> None:
        self.port = port or free_port()
        self._folder = tempfile.TemporaryDirectory()
        self.file = Path(self._folder.name) / "mosquitto.conf"
        self.file.write_text(
            f"listener {self.port} {LOOPBACK}\nallow_anonymous true\nset_tcp_nodelay true\n"
            f"user root\nmax_queued_messages 100000\n"
        )
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Let it listen."""
        program = mosquitto()
        assert program is not None
        self._process = subprocess.Popen(
            [program, "-c", str(self.file)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        wait_open(self.port)

    def kill(self) -> None:
        """End it at once."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None


class Embedded:
    """The broker that `pa-console site --embedded-broker` starts."""

    def __init__(self, port: int = 0) -> None:
        self.port = port or free_port()
        self._broker: AbstractContextManager[None] | None = None

    def start(self) -> None:
        """Let it listen."""
        self._broker = run_broker(self.port)
        self._broker.__enter__()

    def kill(self) -> None:
        """End it at once."""
        if self._broker is not None:
            self._broker.__exit__(None, None, None)
            self._broker = None


PUBLISH, PUBACK, AT_LEAST_ONCE = 3, 0x40, 1
"""A kind of MQTT packet, the first byte of its acknowledgement, and the quality that wants one."""


class Lossy:
    """A port in front of a broker; of what is published through it, a `share` is lost unseen.

    That goes for both directions, as with a broker that drops messages.
    """

    def __init__(self, broker: Broker, share: float, seed: int = 0) -> None:
        self.port, self.lost = free_port(), 0
        self._behind, self._share, self._random = broker.port, share, Random(seed)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        serving = asyncio.start_server(self._serve, LOOPBACK, self.port)
        asyncio.run_coroutine_threadsafe(serving, self._loop).result(UP_S)
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(UP_S)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        behind, beyond = await asyncio.open_connection(LOOPBACK, self._behind)
        both = [
            asyncio.create_task(self._relay(reader, beyond, writer)),
            asyncio.create_task(self._relay(behind, writer, beyond)),
        ]
        await asyncio.wait(both, return_when=asyncio.FIRST_COMPLETED)
        writer.close()
        beyond.close()
        await asyncio.gather(*both, return_exceptions=True)

    async def _relay(
        self, source: asyncio.StreamReader, to: asyncio.StreamWriter, back: asyncio.StreamWriter
    ) -> None:
        """Pass packets from `source` on; acknowledge a lost one to its sender."""
        while True:
            head = await source.readexactly(1)
            length = shift = 0
            while head[-1] & 0x80 or len(head) == 1:
                head += await source.readexactly(1)
                length |= (head[-1] & 0x7F) << shift
                shift += 7
            body = await source.readexactly(length)
            if head[0] >> 4 != PUBLISH or self._random.random() >= self._share:
                to.write(head + body)
                await to.drain()
                continue
            self.lost += 1
            if head[0] >> 1 & 3 == AT_LEAST_ONCE:
                at = 2 + int.from_bytes(body[:2], "big")
                back.write(bytes((PUBACK, 2)) + body[at : at + 2])


def any_broker() -> Broker:
    pytest.importorskip("aiomqtt", reason="the bus, and its tests, need the extra `vda5050`")
    return Mosquitto() if mosquitto() else Embedded()


def wait_open(port: int) -> None:
    until = time.monotonic() + UP_S
    while time.monotonic() < until:
        try:
            socket.create_connection((LOOPBACK, port), timeout=1.0).close()
        except OSError:
            time.sleep(0.01)
        else:
            return
    raise TimeoutError(f"no broker on port {port}")


def address_of(broker: "Broker | Lossy", site: str) -> BrokerAddress:
    return BrokerAddress(LOOPBACK, broker.port, site)
