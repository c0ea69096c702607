"""A `taky` server in a process of its own, and what a second client of it sees."""

import socket
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Self, cast
from xml.etree.ElementTree import Element, XMLPullParser

from tests.fleets.broker import free_port

LIMIT_S = 300.0
LOOPBACK = "127.0.0.1"


class Client:
    """Another client of the server; `seen` is every event that has come, the oldest first."""

    def __init__(self, connected: socket.socket) -> None:
        self.seen: list[Element] = []
        self._socket, self._parser = connected, XMLPullParser(("end",))
        self._parser.feed("<events>")
        self._socket.settimeout(0.1)

    def wait(self, told: Callable[[list[Element]], object]) -> list[Element]:
        """Return what has come once `told` says that it has all come."""
        end = time.monotonic() + LIMIT_S
        while not told(self.seen):
            assert time.monotonic() < end, f"it did not come; {len(self.seen)} events did"
            try:
                data = self._socket.recv(65_536)
            except TimeoutError:
                continue
            assert data, "the server closed the connection"
            self._parser.feed(data)
            events = cast(Iterable[tuple[str, Element]], self._parser.read_events())
            self.seen += [element for _, element in events if element.tag == "event"]
        return self.seen

    def send(self, data: bytes) -> None:
        """Send raw bytes to the server."""
        self._socket.sendall(data)


class Taky:
    """A server that can be ended, and started again on the same port."""

    def __init__(self, folder: Path, tls: Mapping[str, Path] | None = None) -> None:
        """`tls` is its own certificate (`cert`, `key`) and the authority of its clients (`ca`)."""
        self.port = free_port()
        self._folder, self._tls = folder, tls
        self._open_port = free_port() if tls else self.port
        """Without encryption, also where the server itself takes none: there one only listens."""
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def url(self) -> str:
        """Where it listens."""
        return f"{'tls' if self._tls else 'tcp'}://{LOOPBACK}:{self.port}"

    def start(self) -> None:
        """Let it listen."""
        file = self._folder / "taky.conf"
        file.write_text(
            f"[taky]\nbind_ip={LOOPBACK}\nroot_dir={self._folder}\n"
            f"[cot_server]\nport={self.port}\nmon_ip={LOOPBACK}\nmon_port={self._open_port}\n"
            f"[ssl]\nenabled={str(bool(self._tls)).lower()}\n"
            + "".join(f"{name}={path}\n" for name, path in (self._tls or {}).items())
        )
        words = [sys.executable, "-m", "taky.cot", "-l", "error", "-c", str(file)]
        self._process = subprocess.Popen(
            words, cwd=self._folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        self._until_it_listens()

    def kill(self) -> None:
        """End it at once."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None

    @contextmanager
    def client(self) -> Generator[Client]:
        """Connect another client, which hears what everybody else sends from now on."""
        with socket.create_connection((LOOPBACK, self._open_port), LIMIT_S) as connected:
            client = Client(connected)
            client.send(PING)
            client.wait(lambda seen: any(each.get("type") == "t-x-c-t-r" for each in seen))
            client.seen.clear()
            yield client

    def _until_it_listens(self) -> None:
        end = time.monotonic() + LIMIT_S
        while True:
            try:
                socket.create_connection((LOOPBACK, self._open_port), 1.0).close()
            except OSError:
                assert time.monotonic() < end, "taky does not listen"
                assert self._process is not None
                assert self._process.poll() is None, "taky has ended"
                time.sleep(0.05)
            else:
                return

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()


PING = (
    b'<event version="2.0" uid="other-ping" type="t-x-c-t" how="m-g" '
    b'time="2026-01-01T00:00:00.000Z" start="2026-01-01T00:00:00.000Z" '
    b'stale="2036-01-01T00:00:00.000Z"><point lat="0" lon="0" hae="0" ce="9" le="9"/></event>'
)
"""Once it is answered, the server knows the client."""
