"""The common base of links that have their own thread: their news and their opening."""

import time
from collections import deque
from collections.abc import Callable, Sequence
from threading import Event
from typing import TypeVar

from pa_console.fleets.link import Link, LinkNews, LinkNotice

MOST_NEWS = 20_000
"""The largest number of waiting news items; beyond it, the oldest are dropped."""

PATIENCE_S = 10.0
"""The longest wait for a connection when a link is opened, in seconds."""


class ThreadedLink:
    """The queue of news from the thread of a link to the thread of the station."""

    def __init__(self, name: str) -> None:
        self.name = name
        """The name of the link on the screen."""
        self._news: deque[LinkNews] = deque(maxlen=MOST_NEWS)
        self._arrived = Event()

    def take(self) -> Sequence[LinkNews]:
        """Return the news since the last call, in order of arrival."""
        self._arrived.clear()
        return [self._news.popleft() for _ in range(len(self._news))]

    def wait(self, seconds: float) -> bool:
        """Wait at most `seconds` for news; return whether any has arrived."""
        return self._arrived.wait(seconds)

    def _tell(self, news: LinkNews) -> None:
        self._news.append(news)
        self._arrived.set()

    def _guarded(self, work: Callable[[], object]) -> None:
        """Call `work`; report an error as a notice, so that no message ends the session."""
        try:
            work()
        except Exception as error:
            text = f"a message is set aside: {type(error).__name__}: {error}"
            self._tell(LinkNotice("alarm", self.name.partition(":")[0], text))


L = TypeVar("L", bound=Link)


def opened(link: L, url: str, remedy: str) -> L:
    """Return `link` once it has a connection.

    If there is none within PATIENCE_S, close the link and raise ValueError with the remedy.
    """
    until_s = time.monotonic() + PATIENCE_S
    while link.problem and time.monotonic() < until_s:
        time.sleep(0.05)
    if problem := link.problem:
        link.close()
        raise ValueError(f"--fleet {url}: {problem}: {remedy}")
    return link
