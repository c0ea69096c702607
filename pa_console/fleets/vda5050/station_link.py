"""A station's connection to the broker, in threads of its own: no message waits for the screen.

Commands and what people send go over one connection, telemetry comes over another: however much
robots report, a stop is not queued behind it. Each sender may send more than any robot reports, and
less than a flood; notices of what happens on the bus are limited as well. Joining a bus takes what
is retained there and names the new robots.
"""

import asyncio
import secrets
import threading
from collections import Counter, OrderedDict, deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache, partial
from time import monotonic
from typing import NamedTuple

from pa_console.fleets.link import FoundRobot
from pa_console.fleets.newcomers import with_robots
from pa_console.fleets.vda5050 import additions, messages
from pa_console.fleets.vda5050.additions import Countersignature, RecordsAsked, StopAsked
from pa_console.fleets.vda5050.broker import (
    BrokerAddress,
    BusClient,
    Credentials,
    IncomingMessage,
    OutgoingMessage,
    say_nothing,
)
from pa_console.fleets.vda5050.messages import Factsheet
from pa_console.fleets.vda5050.wire import Header, Identity, Topic, UnreadableError
from pa_console.schema.command import COMMANDS
from pa_console.schema.world import AssetKind, World

MESSAGES_PER_S, MESSAGES_AT_ONCE = 100.0, 200.0
"""A robot reports some times a second; a simulated site that runs twenty times faster, 40 times."""

BYTES_PER_S, BYTES_AT_ONCE = 512_000.0, 1_024_000.0
"""A state has two to ten kilobytes; reading these takes some milliseconds of each second."""

MOST_SENDERS = 20_000
"""The number of senders and topics with a share of their own; the longest silent are forgotten."""


class RateLimit:
    """A token bucket for each sender and topic, of messages and of bytes."""

    def __init__(self, clock: Callable[[], float]) -> None:
        """`clock` returns seconds."""
        self._clock = clock
        self._left: OrderedDict[Topic, tuple[float, float, float]] = OrderedDict()
        """Messages and bytes left, and the moment of that, by topic."""

    def allows(self, topic: Topic, size: int) -> bool:
        """Take a message of `size` bytes off its sender's share; return False beyond it."""
        now = self._clock()
        full = (MESSAGES_AT_ONCE, BYTES_AT_ONCE, now)
        messages, octets, then = self._left.pop(topic, full)
        messages = min(messages + (now - then) * MESSAGES_PER_S, MESSAGES_AT_ONCE)
        octets = min(octets + (now - then) * BYTES_PER_S, BYTES_AT_ONCE)
        allowed = messages >= 1.0 and octets >= size
        if allowed:
            messages, octets = messages - 1.0, octets - size
        self._left[topic] = (messages, octets, now)
        if len(self._left) > MOST_SENDERS:
            self._left.popitem(last=False)
        return allowed


MOST_WAITING = 20_000
"""The number of messages that may wait to be taken in; further ones are dropped and counted."""

GOODBYE_S = 2.0
_topic_of = lru_cache(maxsize=8192)(Topic.of)
Kinds = Sequence[type[Header]]


class Delivery(NamedTuple):
    """A message as read, or why it cannot be read, and when it came (UTC)."""

    topic: Topic
    message: Header | UnreadableError
    retained: bool
    at: datetime


class StationLink:
    """Receives the messages of `kinds` from every robot and station of a site, and sends.

    `telemetry` are the kinds that come over a connection of their own, with the credentials
    `telemetry_as` where the broker asks for a certificate; on one connection for all of them where
    it asks and there are none. Messages of one sender that come faster than any robot reports are
    set aside before they are read.
    """

    def __init__(
        self,
        address: BrokerAddress,
        name: str,
        kinds: Kinds,
        credentials: Credentials | None = None,
        *,
        telemetry: Kinds = (),
        telemetry_as: Credentials | None = None,
    ) -> None:
        self.address = address
        self._waiting: deque[Delivery] = deque()
        self._flooded: Counter[Identity] = Counter()
        self.dropped = 0
        """The number of messages dropped because too many were waiting."""
        self.limit: RateLimit | None = RateLimit(monotonic)
        """The limit on each sender; None reads every message, as of a site that waits for its
        station."""
        self._news = threading.Event()
        apart = bool(telemetry) and (credentials is None or telemetry_as is not None)
        self._main = self._open(name, kinds if apart else (*kinds, *telemetry), credentials)
        self._channels = [self._main]
        if apart:
            self._channels.append(self._open(f"{name}-telemetry", telemetry, telemetry_as))

    def _open(self, name: str, kinds: Kinds, credentials: Credentials | None) -> "_Channel":
        by_topic = {kind.TOPIC: kind for kind in kinds}
        client = partial(
            BusClient,
            self.address,
            name,
            partial(self._heard, by_topic),
            topics=[f"{self.address.site}/v3/+/+/{topic}" for topic in by_topic],
            credentials=credentials,
        )
        return _Channel(client, name, self._news.set)

    @property
    def problem(self) -> str:
        """The reason why there is no connection, "" while there is one."""
        return next((channel.problem for channel in self._channels if channel.problem), "")

    def wait_connected(self, seconds: float) -> bool:
        """Return whether there is a connection within `seconds`."""
        until = monotonic() + seconds
        return all(channel.up.wait(max(until - monotonic(), 0.0)) for channel in self._channels)

    def wait_news(self, seconds: float) -> bool:
        """Return whether a message can be taken within `seconds`."""
        found = self._news.wait(seconds)
        self._news.clear()
        return found or bool(self._waiting)

    def take(self) -> list[Delivery]:
        """Return what has come since the last call, in order."""
        return [self._waiting.popleft() for _ in range(len(self._waiting))]

    def take_flooded(self) -> Mapping[Identity, int]:
        """Return how many messages of each sender were set aside unread since the last call."""
        flooded, self._flooded = self._flooded, Counter()
        return flooded

    def publish(self, *messages: OutgoingMessage) -> bool:
        """Send the messages in order; return False, and send none, without a connection."""
        return self._main.publish(messages)

    def close(self) -> None:
        """End the connection after the pending messages are sent."""
        for channel in self._channels:
            channel.end()
        for channel in self._channels:
            channel.join()

    def _heard(self, kinds: Mapping[str, type[Header]], received: IncomingMessage) -> None:
        topic = _topic_of(received.topic)
        if topic is None or topic.name not in kinds:
            return
        if self.limit is not None and not self.limit.allows(topic, len(received.payload)):
            self._flooded[topic.identity] += 1
            return
        if len(self._waiting) >= MOST_WAITING:
            self.dropped += 1
            return
        message: Header | UnreadableError
        try:
            message = kinds[topic.name].read(received.payload)
            if (message.manufacturer, message.serial_number) != topic.identity:
                message = UnreadableError("it says that it is another robot's")
        except UnreadableError as error:
            message = error
        self._waiting.append(Delivery(topic, message, received.retained, datetime.now(UTC)))
        self._news.set()


class _Channel:
    """One connection in a thread of its own; `news` is called when it breaks, or is there again."""

    def __init__(
        self, client: Callable[..., BusClient], name: str, news: Callable[[], None]
    ) -> None:
        self._news = news
        self.problem = "not connected yet"
        """The reason why there is no connection, "" while there is one."""
        self.up = threading.Event()
        self._loop, self._ending = asyncio.new_event_loop(), asyncio.Event()
        self._loop.set_exception_handler(say_nothing)
        self._client = client(changed=self._changed)
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def publish(self, messages: Sequence[OutgoingMessage]) -> bool:
        """Send the messages in order; return False, and send none, without a connection."""
        if not self.up.is_set():
            return False
        with suppress(RuntimeError):  # the link is closed
            self._loop.call_soon_threadsafe(self._send, messages)
        return True

    def end(self) -> None:
        """Begin to end the connection after the pending messages are sent."""
        if self._thread.is_alive():
            with suppress(RuntimeError):
                self._loop.call_soon_threadsafe(self._ending.set)

    def join(self) -> None:
        """Wait until the connection has ended."""
        self._thread.join(GOODBYE_S + 1.0)

    def _send(self, messages: Sequence[OutgoingMessage]) -> None:
        for message in messages:
            self._client.send(message)

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        finally:
            self._loop.close()

    async def _serve(self) -> None:
        running = asyncio.create_task(self._client.run())
        ending = asyncio.create_task(self._ending.wait())
        await asyncio.wait((running, ending), return_when=asyncio.FIRST_COMPLETED)
        with suppress(TimeoutError):
            async with asyncio.timeout(GOODBYE_S):
                await self._client.sent()
        for task in (running, ending):
            task.cancel()
        results = await asyncio.gather(running, ending, return_exceptions=True)
        error = results[0]
        if isinstance(error, Exception):
            self._changed(False, f"{type(error).__name__}: {error}")

    def _changed(self, connected: bool, why: str) -> None:
        self.problem = why
        if connected:
            self.up.set()
        else:
            self.up.clear()
        self._news()


TELEMETRY = (
    messages.RobotConnection,
    messages.RobotState,
    Factsheet,
    additions.Detections,
    additions.SiteDescription,
    additions.ClockDone,
    additions.IncidentDone,
    additions.ScenarioNews,
)
"""The messages of robots, cameras and a simulated site."""

FROM_PEOPLE = (*additions.SIGNED, RecordsAsked, Countersignature, StopAsked)
"""The messages of people: members and command of the site, requests of joined consoles."""

CONNECT_S = 5.0
RETAINED_S = 0.3
"""Retained messages are complete after this silence, seconds; live messages never end."""
MOST_RETAINED_S = 10.0
"""The longest wait for retained messages, seconds."""


@dataclass(frozen=True)
class JoinedBus:
    """A bus that was joined, with the retained messages found there."""

    link: StationLink
    site: additions.SiteDescription | None
    factsheets: dict[Identity, Factsheet]
    online: frozenset[Identity]
    """The identities that are connected."""
    deliveries: tuple[Delivery, ...]


def join(
    address: BrokerAddress,
    credentials: Credentials | None = None,
    telemetry: Credentials | None = None,
) -> JoinedBus:
    """Connect to the broker and receive the retained messages; raises ValueError without a broker.

    `telemetry` are the credentials of the connection that only receives.
    """
    link = StationLink(
        address, f"station-{secrets.token_hex(4)}", FROM_PEOPLE, credentials,
        telemetry=TELEMETRY, telemetry_as=telemetry,
    )  # fmt: skip
    if not link.wait_connected(CONNECT_S):
        problem = link.problem
        link.close()
        raise ValueError(f"no broker lets us in at {address}: {problem}")
    deliveries = take_retained(link)
    site: additions.SiteDescription | None = None
    factsheets: dict[Identity, Factsheet] = {}
    states: dict[Identity, messages.ConnectionState] = {}
    for delivery in deliveries:
        match delivery.message:
            case additions.SiteDescription() if delivery.topic.identity == additions.SITE:
                site = delivery.message
            case Factsheet():
                factsheets.setdefault(delivery.topic.identity, delivery.message)
            case messages.RobotConnection():
                states[delivery.topic.identity] = delivery.message.connection_state
            case _:
                pass
    online = frozenset(identity for identity, state in states.items() if state == "ONLINE")
    return JoinedBus(link, site, factsheets, online, tuple(deliveries))


def take_retained(link: StationLink) -> list[Delivery]:
    """Return what comes until all that is retained has come, live messages among it."""
    deliveries: list[Delivery] = []
    now = monotonic()
    end, quiet = now + MOST_RETAINED_S, now + RETAINED_S
    while (left := min(end, quiet) - monotonic()) > 0:
        link.wait_news(left)
        taken = link.take()
        deliveries += taken
        if any(delivery.retained for delivery in taken):
            quiet = monotonic() + RETAINED_S
    return deliveries


def with_newcomers(world: World, joined: JoinedBus) -> tuple[World, tuple[str, ...]]:
    """Return `world` with the robots that are on the bus and not in it, and a line about each.

    Each becomes an asset of the kind that its factsheet shows, with that kind's platform.
    """
    found = [
        FoundRobot(identity.serial_number, kind_of(sheet), detail=f"of {identity.manufacturer}")
        for identity, sheet in sorted(joined.factsheets.items())
        if identity in joined.online
    ]
    added, told = with_robots(world, found)
    if not added:
        return world, told
    return world.model_copy(update={"assets": {**world.assets, **added}}), told


def kind_of(sheet: Factsheet) -> AssetKind:
    """Return the kind of asset of a robot, by its class, else by its abilities."""
    said = sheet.type_specification.mobile_robot_class.lower()
    named: Mapping[str, AssetKind] = {"uav": "uav", "ugv": "ugv", "robot": "robot"}
    if said in named:
        return named[said]
    special: tuple[AssetKind, ...] = ("uav", "ugv")
    for kind in special:
        alone = frozenset((kind,))
        if any(sheet.offers(verb) for verb, spec in COMMANDS.items() if spec.kinds == alone):
            return kind
    return "robot"
