"""Delivery of alerts by mail, chat and push services, in threads that never delay the session.

It requires the extra `alert`: the library Apprise, which identifies services by their addresses. An
address holds secrets, so a receiver is named only by its number and its service.
"""

import logging
import re
from collections import deque
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from queue import Empty, Full, Queue
from threading import Event, Thread
from time import monotonic
from typing import Any, Protocol

from apprise import Apprise, AppriseAsset

SEND_S = 10.0
"""The longest duration of one try, in seconds."""
TRIES_AFTER_S = (0.0, 5.0, 30.0)
"""The wait in seconds before each try to deliver a message."""
MOST_WAITING = 20
"""The largest number of messages that wait for a slow receiver; further messages are dropped."""
MOST_HANGING = 3
"""The largest number of tries that may hang at once; further tries fail until one has ended."""
LEAVE_S = 2.0
"""The longest wait for messages under way at the end of a session, in seconds."""

_log = logging.getLogger("apprise")
_log.addHandler(logging.NullHandler())
_log.propagate = False  # the messages of the library contain addresses


class Letter(Protocol):
    """A message to deliver."""

    @property
    def title(self) -> str:
        """The first line of the message."""
        ...

    @property
    def body(self) -> str:
        """The other lines."""
        ...

    @property
    def later(self) -> bool:
        """True if the message also goes to receivers that get only reminders."""
        ...


@dataclass
class Receiver:
    """The receiver at one address; `name` has no secrets, and `later` means reminders only."""

    name: str
    later: bool
    service: Apprise = field(repr=False)
    _hanging: list[Thread] = field(default_factory=list[Thread], repr=False)

    @classmethod
    def parse(cls, address: str, number: int, *, later: bool = False) -> "Receiver":
        """Return the receiver at an address; raises ValueError with a text without the address."""
        service = Apprise(asset=AppriseAsset(async_mode=False, app_id="PA Console"))
        if not service.add(address):
            scheme = re.match(r"[a-z]{2,12}(?=://)", address)
            raise ValueError(
                f"alert receiver {number} ({scheme[0] if scheme else 'without a service'}://...) "
                "has no address that Apprise supports; use an address such as "
                "mailtos://USER:PASSWORD@HOST or ntfys://HOST/TOPIC"
            )
        [plugin] = service
        return cls(f"receiver {number} ({plugin.service_name!s})", later, service)

    def try_once(self, letter: Letter, limit_s: float = SEND_S) -> str:
        """Deliver a message within `limit_s` seconds; return why that failed, '' if it worked."""
        self._hanging = [thread for thread in self._hanging if thread.is_alive()]
        if len(self._hanging) >= MOST_HANGING:
            return f"{MOST_HANGING} earlier tries still hang"
        result: list[bool] = []

        def send() -> None:
            try:
                sent: Any = self.service.notify(title=letter.title, body=letter.body)
                result.append(bool(sent))
            except Exception:  # a service may raise anything, and the text contains secrets
                result.append(False)

        thread = Thread(target=send, name="alert-try", daemon=True)
        thread.start()
        thread.join(limit_s)
        if not result:
            self._hanging.append(thread)
            return f"no answer within {limit_s:g} s"
        return "" if result[0] else "refused, or not reached"


def receivers(now: Sequence[str], later: Sequence[str] = ()) -> list[Receiver]:
    """Return the receivers at these addresses; raises ValueError for an invalid address."""
    return [
        Receiver.parse(address, number, later=number > len(now))
        for number, address in enumerate([*now, *later], 1)
    ]


def try_all(to: Sequence[Receiver], letter: Letter) -> dict[str, str]:
    """Deliver a message to all receivers at once; return by name why each failed, or ''."""
    with ThreadPoolExecutor(len(to)) as trying:
        tries = {receiver.name: trying.submit(receiver.try_once, letter) for receiver in to}
    return {name: tried.result() for name, tried in tries.items()}


class AlertDelivery:
    """Delivery to several receivers, each in its own thread, so that none delays another.

    `give` and `news` return at once.
    """

    def __init__(
        self,
        to: Sequence[Receiver],
        limit_s: float = SEND_S,
        tries_after_s: Sequence[float] = TRIES_AFTER_S,
    ) -> None:
        self._limit_s, self._tries_after_s = limit_s, tries_after_s
        self._left = Event()
        self._news: deque[str] = deque(maxlen=100)
        self._queues = [(each, Queue[Letter | None](MOST_WAITING)) for each in to]
        self._threads = [
            Thread(target=self._deliver, args=pair, name="alert-receiver", daemon=True)
            for pair in self._queues
        ]
        for thread in self._threads:
            thread.start()

    def give(self, message: Letter) -> None:
        """Start the delivery of a message; returns at once."""
        for receiver, queue in self._queues:
            if message.later or not receiver.later:
                try:
                    queue.put_nowait(message)
                except Full:
                    self._news.append(f"{receiver.name} not alerted: too many alerts wait for it")

    def news(self) -> Sequence[str]:
        """Return the results of deliveries since the last call, one line each."""
        return [self._news.popleft() for _ in range(len(self._news))]

    def close(self, wait_s: float = LEAVE_S) -> None:
        """Stop once all messages are delivered, or after `wait_s` seconds."""
        for _, queue in self._queues:
            try:
                queue.put_nowait(None)
            except Full:
                continue
        until = monotonic() + wait_s
        for thread in self._threads:
            thread.join(max(0.0, until - monotonic()))
        self._left.set()

    def _deliver(self, receiver: Receiver, queue: "Queue[Letter | None]") -> None:
        while not self._left.is_set():
            try:
                letter = queue.get(timeout=1.0)
            except Empty:
                continue
            if letter is None:
                return
            why = ""
            for wait_s in self._tries_after_s:
                if self._left.wait(wait_s):
                    return
                why = receiver.try_once(letter, self._limit_s)
                if not why:
                    break
            result = f"not alerted, {why}" if why else "alerted"
            self._news.append(f"{receiver.name} {result}: {letter.title}")
