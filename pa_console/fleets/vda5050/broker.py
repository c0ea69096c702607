"""The broker of a site: its address, the certificates of its clients, and a connection to it.

A connection is made again whenever it breaks; nothing waits for it. What cannot be sent at once is
not sent: an order that goes out late is worse than one that does not. The sender has to see from
the answers whether a message arrived, and to send again.
"""

import asyncio
import fcntl
import logging
import socket
import ssl
import tempfile
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Self

from pydantic import TypeAdapter, ValidationError

from pa_console.fleets.vda5050.wire import Token
from pa_console.network_address import host_and_port, is_this_machine, server_address
from pa_console.resources import install_hint

if TYPE_CHECKING:
    from aiomqtt import Client

PORTS = {"mqtt": 1883, "mqtts": 8883}
INTERFACE = "vda5050"
CA_FILE = "ca.crt"
FORM = "mqtts://HOST[:PORT][/SITE]"
NUMBERS = ("", "-2", "-3")
"""The endings of the certificates that one machine has for a role, such as `station` and
`station-2`: a console, a script beside it, and a verb of `keys` beside both."""


@dataclass(frozen=True)
class Credentials:
    """A certificate, its key, and the certificate of the authority that signed the broker's."""

    ca: Path
    certificate: Path
    key: Path
    claimed: BinaryIO | None = field(default=None, compare=False, repr=False)
    """The file of the key, which no other program of this machine claims while it is open."""

    @classmethod
    def of(cls, folder: Path, name: str) -> Self:
        """Return those of `name` in a folder that `site init` made; raises ValueError."""
        found = cls(folder / CA_FILE, folder / f"{name}.crt", folder / f"{name}.key")
        for path in (found.ca, found.certificate, found.key):
            if not path.is_file():
                raise ValueError(
                    f"{path} is not there; 'pa-console site init {folder}' makes certificates"
                )
        return found

    @classmethod
    def claim(cls, folder: Path, role: str) -> Self:
        """Return those of `role` in a folder that no other program of this machine uses.

        The broker lets one connection in by each certificate: a second one would end the first,
        and with it that program's stops. Raises ValueError when there are none, or none is free.
        """
        alike = [f"{role}{number}" for number in NUMBERS]
        names = [name for name in alike if (folder / f"{name}.crt").is_file()]
        for name in names or [role]:
            found = cls.of(folder, name)
            with suppress(BlockingIOError):
                return replace(found, claimed=_lock(found.key))
        raise ValueError(
            f"other programs of this machine use {', '.join(f'{name}.crt' for name in names)} "
            f"in {folder}, and each connection needs a certificate of its own; end one of them, or "
            "make more where ca.key is: 'pa-console site init FOLDER --station NAME' makes a "
            "folder NAME in it, to be given with --certificates"
        )

    def release(self) -> None:
        """Let other programs of this machine use them."""
        if self.claimed is not None:
            self.claimed.close()

    def context(self) -> ssl.SSLContext:
        """Return how a client with these speaks TLS; raises ValueError for files that do not."""
        try:
            context = ssl.create_default_context(cafile=str(self.ca))
            context.minimum_version = ssl.TLSVersion.TLSv1_2
            context.load_cert_chain(str(self.certificate), str(self.key))
        except (OSError, ssl.SSLError) as error:
            raise ValueError(f"the certificates beside {self.ca} cannot be used: {error}") from None
        return context


@dataclass(frozen=True)
class BrokerAddress:
    """A broker and the site on it; a site's name is the first part of all its topics."""

    host: str
    port: int
    site: str = INTERFACE
    tls: bool = False

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse `mqtts://host:8883/site`; raises ValueError that describes the problem.

        Without encryption, only this machine is allowed.
        """
        parts, host, port = server_address(text, PORTS, "a broker", FORM)
        if parts.query or parts.fragment or parts.username or parts.password:
            raise ValueError(f"{text}: only host, port and site are understood; {FORM}")
        tls = parts.scheme == "mqtts"
        if not tls and not is_this_machine(host):
            raise ValueError(f"{text}: mqtt:// is for this machine alone; use mqtts://")
        site = parts.path.strip("/") or INTERFACE
        try:
            TypeAdapter(Token).validate_python(site)
        except ValidationError:
            raise ValueError(f"{text}: {site!r} cannot be the name of a site") from None
        return cls(host, port, site, tls)

    def __str__(self) -> str:
        scheme = "mqtts" if self.tls else "mqtt"
        return f"{scheme}://{host_and_port(self.host, self.port)}/{self.site}"


def _lock(key: Path) -> BinaryIO | None:
    """Return the file of a key, locked until it is closed; BlockingIOError when another has it."""
    try:
        file = key.open("rb")
    except OSError:  # `context` has the reason
        return None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        raise
    except OSError:  # a disk without locks: there the broker alone keeps programs apart
        pass
    return file


KEEPALIVE_S = 5
FIRST_RETRY_S, LAST_RETRY_S = 0.1, 1.0
CONNECT_S = 5.0
MOST_QUEUED = 2_000
"""The longest queue of received messages; `heard` empties it at once."""

QUIET = logging.getLogger("pa_console.bus")
QUIET.addHandler(logging.NullHandler())
QUIET.propagate = False
"""The library's lines would be written over the screen; the important ones are reported anyway."""


def say_nothing(_loop: asyncio.AbstractEventLoop, _context: dict[str, Any]) -> None:
    """Ignore a broken connection, which the client reports anyway.

    The library still watches the socket of a connection that is gone, and the event loop would
    print that over the screen.
    """


@dataclass(frozen=True)
class IncomingMessage:
    """A message as the broker delivered it; `retained`: it is from before one asked for it."""

    topic: str
    payload: bytes
    retained: bool


@dataclass(frozen=True)
class OutgoingMessage:
    """A message to be sent; the broker drops it after `expiry_s` seconds."""

    topic: str
    payload: bytes
    qos: int = 0
    retain: bool = False
    expiry_s: int | None = None


@dataclass
class BusClient:
    """One connection to the broker under the client id `name`.

    It subscribes to `topics` and leaves `will` when the connection breaks.

    `heard` gets every message, `changed` the state of the connection and the reason for a missing
    one. Everything happens in the event loop that runs it.
    """

    address: BrokerAddress
    name: str
    heard: Callable[[IncomingMessage], None]
    changed: Callable[[bool, str], None]
    topics: Sequence[str] = ()
    will: Callable[[], OutgoingMessage] | None = None
    credentials: Credentials | None = None
    problem: str = "not connected yet"
    """The reason why there is no connection, "" while there is one."""
    _client: "Client | None" = None
    _sending: set[asyncio.Task[None]] = field(default_factory=set[asyncio.Task[None]])

    @property
    def connected(self) -> bool:
        """True while messages can be sent."""
        return self._client is not None

    async def run(self) -> None:
        """Stay connected until cancelled; then another program may use the certificate."""
        try:
            await self._stay_connected()
        finally:
            if self.credentials is not None:
                self.credentials.release()

    async def _stay_connected(self) -> None:
        from aiomqtt import MqttError  # noqa: PLC0415 - a console without a bus needs none

        retry_s = FIRST_RETRY_S
        while True:
            try:
                async with self._connection() as client:
                    for topic in self.topics:
                        await client.subscribe(topic, qos=1)
                    self._client, self.problem, retry_s = client, "", FIRST_RETRY_S
                    self.changed(True, "")
                    async for message in client.messages:
                        topic = str(message.topic)
                        self.heard(IncomingMessage(topic, message.payload, message.retain))
            except (MqttError, OSError) as error:
                why = str(error) or type(error).__name__
                self._client, self.problem = None, why
                self.changed(False, why)
            finally:
                self._client = None
            await asyncio.sleep(retry_s)
            retry_s = min(2 * retry_s, LAST_RETRY_S)

    def send(self, message: OutgoingMessage) -> bool:
        """Send `message` now; return False, and send nothing, without a connection."""
        if self._client is None:
            return False
        task = asyncio.get_running_loop().create_task(self._send(self._client, message))
        self._sending.add(task)
        task.add_done_callback(self._sending.discard)
        return True

    async def sent(self) -> None:
        """Wait until all messages are sent, or cannot be sent any more."""
        while self._sending:
            await asyncio.wait(tuple(self._sending))

    async def _send(self, client: "Client", message: OutgoingMessage) -> None:
        from aiomqtt import MqttError  # noqa: PLC0415
        from paho.mqtt.packettypes import PacketTypes  # noqa: PLC0415
        from paho.mqtt.properties import Properties  # noqa: PLC0415

        properties = None
        if message.expiry_s is not None:
            properties = Properties(PacketTypes.PUBLISH)
            properties.MessageExpiryInterval = message.expiry_s
        try:
            await client.publish(
                message.topic,
                message.payload,
                qos=message.qos,
                retain=message.retain,
                properties=properties,
            )
        except (MqttError, OSError):
            return  # the connection broke; `run` reports it

    def _connection(self) -> "Client":
        from aiomqtt import Client, ProtocolVersion, Will  # noqa: PLC0415

        will = self.will() if self.will is not None else None
        return Client(
            self.address.host,
            self.address.port,
            identifier=self.name,
            protocol=ProtocolVersion.V5,
            keepalive=KEEPALIVE_S,
            timeout=CONNECT_S,
            tls_context=self.credentials.context() if self.credentials is not None else None,
            will=Will(will.topic, will.payload, will.qos, will.retain) if will else None,
            logger=QUIET,
            socket_options=((socket.IPPROTO_TCP, socket.TCP_NODELAY, 1),),
            max_queued_incoming_messages=MOST_QUEUED,
        )


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


@contextmanager
def run_broker(port: int) -> Generator[None]:
    """Run an MQTT 5 broker on a `port` of this machine while the block lasts.

    Raises ValueError without its library, or when the port is taken. It has no certificates, so
    only this machine can reach it.
    """
    try:
        from iotcore import Broker  # noqa: PLC0415 - an extra
    except ImportError:
        raise ValueError(
            f"the embedded broker needs iotcore: {install_hint('fleet')}, "
            "or use Mosquitto: 'pa-console site init FOLDER'"
        ) from None
    with tempfile.TemporaryDirectory(prefix="pa-console-broker-") as folder:
        file = Path(folder) / "broker.toml"
        file.write_text(_CONFIGURATION.format(host=LOOPBACK, port=port), "utf-8")
        broker = Broker(config_path=str(file))
        try:
            broker.start()
        except (OSError, RuntimeError) as error:
            raise ValueError(f"no broker can be started on port {port}: {error}") from None
        try:
            yield
        finally:
            broker.stop()
