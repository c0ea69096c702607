"""A station's link to the broker, which has its own threads and does not wait for the screen.

Commands and the messages of people use one connection, and telemetry uses another, so that a stop
never waits behind reports. Each sender has a limit that is higher than the rate of any robot and
lower than a flood. `join` connects to a bus and receives its retained messages; `with_newcomers`
adds the new robots there to a world.
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
    require_client,
    say_nothing,
)
from pa_console.fleets.vda5050.messages import Factsheet
from pa_console.fleets.vda5050.wire import Header, Identity, Topic, UnreadableError
from pa_console.schema.command import COMMANDS
from pa_console.schema.world import AssetKind, World

MESSAGES_PER_S, MESSAGES_AT_ONCE = 100.0, 200.0
"""The limit of messages from one sender on one topic, per second and at once.

A robot reports a few times per second, or 40 times at a simulated site that runs 20 times as fast.
"""

BYTES_PER_S, BYTES_AT_ONCE = 512_000.0, 1_024_000.0
"""The limit of bytes from one sender on one topic, per second and at once.

A state has two to ten kilobytes. Reading as many bytes as the limit takes a few milliseconds.
"""

MOST_SENDERS = 20_000
"""The largest number of senders and topics with separate limits; the least recent are dropped."""

MOST_WAITING = 20_000
"""The largest number of waiting messages; further ones are dropped and counted."""

GOODBYE_S = 2.0
"""The longest wait for pending messages when a connection ends, in seconds."""

CONNECT_S = 5.0
RETAINED_S = 0.3
"""The silence after which all retained messages have arrived, in seconds.

Live messages do not count, because they never end.
"""
MOST_RETAINED_S = 10.0
"""The longest wait for retained messages, in seconds."""


class RateLimit:
    """A token bucket of messages and of bytes for each sender and topic."""

    def __init__(self, clock: Callable[[], float]) -> None:
        """Use `clock`, which returns seconds."""
        self._clock = clock
        self._left: OrderedDict[Topic, tuple[float, float, float]] = OrderedDict()
        """The messages and bytes left on each topic, and the time at which this was computed."""

    def allows(self, topic: Topic, size: int) -> bool:
        """Return whether a message of `size` bytes is within the limit, and count it if it is."""
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


_topic_of = lru_cache(maxsize=8192)(Topic.of)
Kinds = Sequence[type[Header]]


class Delivery(NamedTuple):
    """A message, or the error if it is not valid, with its time of arrival (UTC)."""

    topic: Topic
    message: Header | UnreadableError
    retained: bool
    at: datetime


class StationLink:
    """The link of a station to a site, which sends messages and receives the given `kinds`.

    The kinds in `telemetry` use a separate connection with the credentials `telemetry_as`. If there
    are `credentials` but no `telemetry_as`, all kinds share one connection. Messages beyond the
    limit of their sender are discarded before they are read.
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
        """Open the connections; raises ValueError if the library for them is not installed."""
        require_client()
        self.address = address
        self._waiting: deque[Delivery] = deque()
        self._flooded: Counter[Identity] = Counter()
        self.dropped = 0
        """The number of messages dropped because too many were waiting."""
        self.limit: RateLimit | None = RateLimit(monotonic)
        """The limit for each sender; None for a paced site, which waits for the station."""
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
        """The reason why there is no connection; "" while there is one."""
        return next((channel.problem for channel in self._channels if channel.problem), "")

    def wait_connected(self, seconds: float) -> bool:
        """Wait for all connections, for `seconds` at most; return whether all exist."""
        until = monotonic() + seconds
        return all(channel.up.wait(max(until - monotonic(), 0.0)) for channel in self._channels)

    def wait_news(self, seconds: float) -> bool:
        """Wait at most `seconds` for a message; return whether there is one to take."""
        arrived = self._news.wait(seconds)
        self._news.clear()
        return arrived or bool(self._waiting)

    def take(self) -> list[Delivery]:
        """Return the messages since the last call, in order of arrival."""
        return [self._waiting.popleft() for _ in range(len(self._waiting))]

    def take_flooded(self) -> Mapping[Identity, int]:
        """Return the number of messages beyond the limit since the last call, by sender."""
        flooded, self._flooded = self._flooded, Counter()
        return flooded

    def publish(self, *messages: OutgoingMessage) -> bool:
        """Send the messages in order; without a connection, send none and return False."""
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
                message = UnreadableError("its header names another robot")
        except UnreadableError as error:
            message = error
        self._waiting.append(Delivery(topic, message, received.retained, datetime.now(UTC)))
        self._news.set()


class _Channel:
    """One connection with its own thread; `news` is called when it breaks or is restored."""

    def __init__(
        self, client: Callable[..., BusClient], name: str, news: Callable[[], None]
    ) -> None:
        self._news = news
        self.problem = "not connected yet"
        """The reason why there is no connection; "" while there is one."""
        self.up = threading.Event()
        self._loop, self._ending = asyncio.new_event_loop(), asyncio.Event()
        self._loop.set_exception_handler(say_nothing)
        self._client = client(changed=self._changed)
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def publish(self, messages: Sequence[OutgoingMessage]) -> bool:
        """Send the messages in order; without a connection, send none and return False."""
        if not self.up.is_set():
            return False
        with suppress(RuntimeError):  # the link is closed
            self._loop.call_soon_threadsafe(self._send, messages)
        return True

    def end(self) -> None:
        """Start to end the connection, after the pending messages are sent."""
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
"""The messages of people: signed messages, and the requests of joined consoles."""


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
    """Connect to the broker, and receive the retained messages.

    `telemetry` are the credentials of the connection that only receives. Raises ValueError if there
    is no connection within CONNECT_S.
    """
    link = StationLink(
        address, f"station-{secrets.token_hex(4)}", FROM_PEOPLE, credentials,
        telemetry=TELEMETRY, telemetry_as=telemetry,
    )  # fmt: skip
    if not link.wait_connected(CONNECT_S):
        problem = link.problem
        link.close()
        raise ValueError(f"cannot connect to the broker at {address}: {problem}")
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
    """Return the messages that arrive until the last retained one, including live messages."""
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
    """Return `world` with the new robots on the bus as assets, and a line about each of them."""
    added, lines = with_robots(world, robots_on(joined))
    if not added:
        return world, lines
    return world.model_copy(update={"assets": {**world.assets, **added}}), lines


def robots_on(joined: JoinedBus) -> list[FoundRobot]:
    """Return the robots that are connected, with the kinds that follow from their factsheets."""
    return [
        FoundRobot(identity.serial_number, kind_of(sheet), detail=f"of {identity.manufacturer}")
        for identity, sheet in sorted(joined.factsheets.items())
        if identity in joined.online
    ]


def kind_of(sheet: Factsheet) -> AssetKind:
    """Return the asset kind of a robot, from its class or else from the actions that it offers."""
    class_name = sheet.type_specification.mobile_robot_class.lower()
    named: Mapping[str, AssetKind] = {"uav": "uav", "ugv": "ugv", "robot": "robot"}
    if class_name in named:
        return named[class_name]
    special: tuple[AssetKind, ...] = ("uav", "ugv")
    for kind in special:
        alone = frozenset((kind,))
        if any(sheet.offers(verb) for verb, spec in COMMANDS.items() if spec.kinds == alone):
            return kind
    return "robot"
