"""The part that links with a thread of their own share: their news, and how they are opened."""

import time
from collections import deque
from collections.abc import Callable, Sequence
from threading import Event
from typing import TypeVar

from pa_console.fleets.link import Link, LinkNews, LinkNotice

MOST_NEWS = 20_000
"""The news that may wait to be taken; the oldest gives way."""

PATIENCE_S = 10.0
"""The longest wait for a robot when a link is opened, seconds."""


class ThreadedLink:
    """Passes news from the thread of a link to the station's."""

    def __init__(self, name: str) -> None:
        self.name = name
        """The name on the screen."""
        self._news: deque[LinkNews] = deque(maxlen=MOST_NEWS)
        self._arrived = Event()

    def take(self) -> Sequence[LinkNews]:
        """Return what came in since the last call, in order of arrival."""
        self._arrived.clear()
        return [self._news.popleft() for _ in range(len(self._news))]

    def wait(self, seconds: float) -> bool:
        """Wait until there is news, for `seconds` at most; return whether there is."""
        return self._arrived.wait(seconds)

    def _tell(self, news: LinkNews) -> None:
        self._news.append(news)
        self._arrived.set()

    def _guarded(self, work: Callable[[], object]) -> None:
        """Do one thing; no message ends the session that it reaches."""
        try:
            work()
        except Exception as error:
            text = f"a message is set aside: {type(error).__name__}: {error}"
            self._tell(LinkNotice("alarm", self.name.partition(":")[0], text))


L = TypeVar("L", bound=Link)


def opened(link: L, url: str, remedy: str) -> L:
    """Return `link` once it has a connection.

    Closes it and raises ValueError with the remedy if there is none within PATIENCE_S.
    """
    until_s = time.monotonic() + PATIENCE_S
    while link.problem and time.monotonic() < until_s:
        time.sleep(0.05)
    if problem := link.problem:
        link.close()
        raise ValueError(f"--fleet {url}: {problem}: {remedy}")
    return link
