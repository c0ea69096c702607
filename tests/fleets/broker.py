"""A broker for tests: Mosquitto where it is installed, else the one of our own process."""

import shutil
import socket
import subprocess
import tempfile
import time
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Protocol

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


def any_broker() -> Broker:
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


def address_of(broker: Broker, site: str) -> BrokerAddress:
    return BrokerAddress(LOOPBACK, broker.port, site)
