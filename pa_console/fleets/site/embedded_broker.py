"""A broker of our own process, to try a site out on one machine where none is installed.

It has no certificates, so only this machine can reach it.
"""

import tempfile
from pathlib import Path
from types import TracebackType
from typing import Self

from pa_console.fleets.bus.address import BrokerAddress

LOOPBACK = "127.0.0.1"
_CONFIGURATION = """\
id = 0
[router]
id = 0
max_connections = 2100
max_outgoing_packet_count = 200
max_segment_size = 104857600
max_segment_count = 10
[v5.1]
name = "v5"
listen = "{host}:{port}"
next_connection_delay_ms = 1
    [v5.1.connections]
    connection_timeout_ms = 5000
    max_payload_size = 1048576
    max_inflight_count = 200
    dynamic_filters = true
"""


class EmbeddedBroker:
    """An MQTT 5 broker on a port of this machine, while the block that it is entered with lasts."""

    def __init__(self, port: int) -> None:
        self.port = port

    def __enter__(self) -> Self:
        """Start it; raises ValueError without its library, or when the port is taken."""
        try:
            from iotcore import Broker  # noqa: PLC0415 - an extra
        except ImportError:
            raise ValueError(
                "the embedded broker needs iotcore: pip install 'pa-console[fleet]', "
                "or use Mosquitto: 'pa-console site init FOLDER'"
            ) from None
        self._folder = tempfile.TemporaryDirectory(prefix="pa-console-broker-")
        file = Path(self._folder.name) / "broker.toml"
        file.write_text(_CONFIGURATION.format(host=LOOPBACK, port=self.port), "utf-8")
        self._broker = Broker(config_path=str(file))
        try:
            self._broker.start()
        except (OSError, RuntimeError) as error:
            self._folder.cleanup()
            raise ValueError(f"no broker can be started on port {self.port}: {error}") from None
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._broker.stop()
        self._folder.cleanup()

    def address(self, site: str) -> BrokerAddress:
        """Return the address of a site on this broker."""
        return BrokerAddress(LOOPBACK, self.port, site)
