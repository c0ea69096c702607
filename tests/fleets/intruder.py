"""Somebody on the bus who sends what they like, and hears everything."""

import socket
import ssl
import threading
from collections.abc import Generator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from pa_console.fleets.vda5050.broker import BrokerAddress, Credentials
from pa_console.fleets.vda5050.wire import MAJOR

if TYPE_CHECKING:
    from paho.mqtt.client import Client, MQTTMessage

UP_S = 10.0


class Intruder:
    """Sends any payload on any topic of a site; keeps the last message of every topic.

    It claims to be the client `client_id`; the broker makes one up for "".
    """

    def __init__(
        self, address: BrokerAddress, credentials: Credentials | None = None, client_id: str = ""
    ) -> None:
        self._address = address
        self.heard: dict[str, bytes] = {}
        self.all: list[tuple[str, bytes]] = []
        self.dropped = 0
        """How often the connection has ended."""
        self._up = threading.Event()
        from paho.mqtt.client import Client  # noqa: PLC0415 - in the extra `vda5050`
        from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion  # noqa: PLC0415

        self._client = Client(
            CallbackAPIVersion.VERSION2, client_id, protocol=MQTTProtocolVersion.MQTTv5
        )
        self._client.on_message = self._note
        self._client.on_subscribe = self._subscribed
        self._client.on_disconnect = self._disconnected
        if address.tls:
            context = credentials.context() if credentials else ssl.create_default_context()
            self._client.tls_set_context(context)
        self._client.on_socket_open = _at_once
        self._client.connect(address.host, address.port)
        self._client.loop_start()
        self._client.subscribe(f"{address.site}/#", qos=1)
        assert self._up.wait(UP_S)

    def _disconnected(self, *_: object) -> None:
        self.dropped += 1

    def _subscribed(self, *_: object) -> None:
        self._up.set()

    def _note(self, _client: "Client", _data: object, message: "MQTTMessage") -> None:
        payload = bytes(message.payload)
        self.heard[message.topic] = payload
        self.all.append((message.topic, payload))

    def topic(self, name: str, topic: str, manufacturer: str = "pa-console") -> str:
        """Return the name of a topic of a robot."""
        return f"{self._address.site}/{MAJOR}/{manufacturer}/{name}/{topic}"

    def send(self, topic: str, payload: bytes, *, retain: bool = False) -> None:
        """Return once the broker has the message."""
        self._client.publish(topic, payload, qos=1, retain=retain).wait_for_publish(UP_S)

    def close(self) -> None:
        """Leave the bus."""
        self._client.disconnect()
        self._client.loop_stop()


def _at_once(_client: "Client", _data: object, opened: object) -> None:
    """Let no message wait for the one before it to be acknowledged."""
    if isinstance(opened, socket.socket):
        opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)


@contextmanager
def intruder(address: BrokerAddress) -> Generator[Intruder]:
    found = Intruder(address)
    try:
        yield found
    finally:
        found.close()
