"""One connection to a broker that is made again whenever it breaks; nothing waits for it.

What cannot be sent at once is not sent: an order that goes out late is worse than one that does
not. Whoever sends has to see from the answers whether anybody heard, and to send again.
"""

import asyncio
import logging
import socket
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from pa_console.fleets.bus.address import BrokerAddress, Credentials

if TYPE_CHECKING:
    from aiomqtt import Client

KEEPALIVE_S = 5
FIRST_RETRY_S, LAST_RETRY_S = 0.1, 1.0
CONNECT_S = 5.0
MOST_QUEUED = 2_000
"""The longest queue between the socket and `heard`, which empties it at once."""

QUIET = logging.getLogger("pa_console.bus")
QUIET.addHandler(logging.NullHandler())
QUIET.propagate = False
"""The library's own lines would be written over the screen; what matters of them is told anyway."""


def say_nothing(_loop: asyncio.AbstractEventLoop, _context: dict[str, Any]) -> None:
    """Take a broken connection without a word: whoever runs a client is told of it anyway.

    The library still watches the socket of a connection that is gone, and the event loop would
    print that over the screen.
    """


@dataclass(frozen=True)
class Received:
    """A message as the broker delivered it; `retained`: it is from before one asked for it."""

    topic: str
    payload: bytes
    retained: bool


@dataclass(frozen=True)
class Sent:
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

    `heard` is called with every message, `changed` with whether there is a connection and why not.
    All of it happens in the event loop that runs it.
    """

    address: BrokerAddress
    name: str
    heard: Callable[[Received], None]
    changed: Callable[[bool, str], None]
    topics: Sequence[str] = ()
    will: Callable[[], Sent] | None = None
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
                        self.heard(Received(topic, message.payload, message.retain))
            except (MqttError, OSError) as error:
                why = str(error) or type(error).__name__
                self._client, self.problem = None, why
                self.changed(False, why)
            finally:
                self._client = None
            await asyncio.sleep(retry_s)
            retry_s = min(2 * retry_s, LAST_RETRY_S)

    def send(self, message: Sent) -> bool:
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

    async def _send(self, client: "Client", message: Sent) -> None:
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
            return  # the connection broke; `run` tells

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
