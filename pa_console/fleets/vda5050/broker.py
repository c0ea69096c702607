"""The broker of a site: its address, the certificates of its clients, and a connection to it.

A broken connection is restored in the background. A message that cannot be sent at once is
dropped, because a late order is worse than none. The sender finds out from the answers whether a
message arrived, and sends it again if necessary.
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
from pa_console.resources import install_hint, missing_library

if TYPE_CHECKING:
    from aiomqtt import Client

PORTS = {"mqtt": 1883, "mqtts": 8883}
INTERFACE = "vda5050"
CA_FILE = "ca.crt"
FORM = "mqtts://HOST[:PORT][/SITE]"
NUMBERS = ("", "-2", "-3")
"""The suffixes of the certificates that one machine has for a role: `station`, `station-2` etc.

Three programs can connect at the same time: a console, a script, and a `keys` command.
"""

KEEPALIVE_S = 5
FIRST_RETRY_S, LAST_RETRY_S = 0.1, 1.0
"""The first and the longest wait before a new attempt to connect, in seconds."""

CONNECT_S = 5.0
MOST_QUEUED = 2_000
"""The longest queue of received messages; `heard` empties it at once."""

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


@dataclass(frozen=True)
class Credentials:
    """A certificate, its key, and the certificate of the authority of the broker's certificate."""

    ca: Path
    certificate: Path
    key: Path
    claimed: BinaryIO | None = field(default=None, compare=False, repr=False)
    """The open file of the key, with a lock against other programs of this machine."""

    @classmethod
    def of(cls, folder: Path, name: str) -> Self:
        """Return the credentials of `name` in `folder`, which `site init` makes.

        Raises ValueError if a file is missing.
        """
        credentials = cls(folder / CA_FILE, folder / f"{name}.crt", folder / f"{name}.key")
        for path in (credentials.ca, credentials.certificate, credentials.key):
            if not path.is_file():
                raise ValueError(
                    f"{path} does not exist; 'pa-console site init {folder}' makes certificates"
                )
        return credentials

    @classmethod
    def claim(cls, folder: Path, role: str) -> Self:
        """Return credentials of `role` in `folder` that no other program of this machine uses.

        The broker accepts only one connection with each certificate. A second connection would end
        the first, and the stops of the first program would be lost. Raises ValueError if there are
        no credentials or none are free.
        """
        alike = [f"{role}{number}" for number in NUMBERS]
        names = [name for name in alike if (folder / f"{name}.crt").is_file()]
        for name in names or [role]:
            credentials = cls.of(folder, name)
            with suppress(BlockingIOError):
                return replace(credentials, claimed=_lock(credentials.key))
        raise ValueError(
            f"other programs of this machine use {', '.join(f'{name}.crt' for name in names)} "
            f"in {folder}, and each connection needs a certificate of its own; end one of them, or "
            "make more where ca.key is: 'pa-console site init FOLDER --station NAME' makes a "
            "folder NAME in it, to be given with --certificates"
        )

    def release(self) -> None:
        """Allow other programs of this machine to use these credentials."""
        if self.claimed is not None:
            self.claimed.close()

    def context(self) -> ssl.SSLContext:
        """Return the TLS context of a client; raises ValueError if a file is not valid."""
        try:
            context = ssl.create_default_context(cafile=str(self.ca))
            context.minimum_version = ssl.TLSVersion.TLSv1_2
            context.load_cert_chain(str(self.certificate), str(self.key))
        except (OSError, ssl.SSLError) as error:
            raise ValueError(f"the certificates beside {self.ca} cannot be used: {error}") from None
        return context


@dataclass(frozen=True)
class BrokerAddress:
    """A broker and a site on it; the name of the site is the first part of all its topics."""

    host: str
    port: int
    site: str = INTERFACE
    tls: bool = False

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the address in a text such as `mqtts://host:8883/site`.

        Raises ValueError with the problem if it is not valid. Without encryption, only this machine
        is allowed.
        """
        parts, host, port = server_address(text, PORTS, "a broker", FORM)
        if parts.query or parts.fragment or parts.username or parts.password:
            raise ValueError(f"{text}: only host, port and site are understood; {FORM}")
        tls = parts.scheme == "mqtts"
        if not tls and not is_this_machine(host):
            raise ValueError(f"{text}: mqtt:// is only for this machine; use mqtts://")
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
    """Return the file of a key, locked until closed; raises BlockingIOError if it is in use."""
    try:
        file = key.open("rb")
    except OSError:  # `context` will raise ValueError with the reason
        return None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        raise
    except OSError:  # a disk without locks; only the broker prevents a second connection
        pass
    return file


QUIET = logging.getLogger("pa_console.bus")
QUIET.addHandler(logging.NullHandler())
QUIET.propagate = False
"""A logger without output, because the library would write over the screen.

`BusClient.changed` reports the important events.
"""


def require_client() -> None:
    """Raise ValueError if the library for clients, which is loaded later, is not installed."""
    if missing := missing_library("aiomqtt", "vda5050", "a message bus needs"):
        raise ValueError(missing)


def say_nothing(_loop: asyncio.AbstractEventLoop, _context: dict[str, Any]) -> None:
    """Ignore an error of the event loop.

    The library still watches the socket of a broken connection, and the event loop would print an
    error over the screen. The client reports the broken connection itself.
    """


@dataclass(frozen=True)
class IncomingMessage:
    """A message from the broker; `retained` is True if it is older than the subscription."""

    topic: str
    payload: bytes
    retained: bool


@dataclass(frozen=True)
class OutgoingMessage:
    """A message to send; the broker drops it after `expiry_s` seconds."""

    topic: str
    payload: bytes
    qos: int = 0
    retain: bool = False
    expiry_s: int | None = None


@dataclass
class BusClient:
    """One connection to the broker under the client id `name`.

    The client subscribes to `topics`. The broker publishes `will` if the connection breaks. `heard`
    gets every message; `changed` gets the state of the connection, and the reason if it is broken.
    All calls happen in the event loop of `run`.
    """

    address: BrokerAddress
    name: str
    heard: Callable[[IncomingMessage], None]
    changed: Callable[[bool, str], None]
    topics: Sequence[str] = ()
    will: Callable[[], OutgoingMessage] | None = None
    credentials: Credentials | None = None
    problem: str = "not connected yet"
    """The reason why there is no connection; "" while there is one."""
    _client: "Client | None" = None
    _sending: set[asyncio.Task[None]] = field(default_factory=set[asyncio.Task[None]])

    @property
    def connected(self) -> bool:
        """True while messages can be sent."""
        return self._client is not None

    async def run(self) -> None:
        """Stay connected until cancelled; then release the certificate for other programs."""
        try:
            await self._stay_connected()
        finally:
            if self.credentials is not None:
                self.credentials.release()

    async def _stay_connected(self) -> None:
        from aiomqtt import MqttError  # noqa: PLC0415 - not needed without a bus

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
        """Wait until all messages are sent or have failed."""
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


@contextmanager
def run_broker(port: int) -> Generator[None]:
    """Run an MQTT 5 broker on a `port` of this machine until the block ends.

    The broker has no certificates, so only this machine can reach it. Raises ValueError if its
    library is missing or the port is in use.
    """
    try:
        from iotcore import Broker  # noqa: PLC0415 - an extra
    except ImportError:
        raise ValueError(
            f"the embedded broker needs iotcore: {install_hint('vda5050')}, "
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
