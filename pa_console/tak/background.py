"""Shows pictures in a thread of its own, so that a session does not wait for them to be drawn."""

from collections.abc import Callable
from threading import Condition, Thread
from types import TracebackType
from typing import Self

from pa_console.schema.events.event import Event, SessionEnded, TelemetryReceived

ENDS_S = 3.0
"""What is still being drawn at the end is waited for so long."""


class InBackground:
    """Gives `show` the pictures and the end of a session while its `with` block lasts.

    Of several pictures that wait only the newest is shown. What `show` raises ends the showing and
    is told to `tell`, in the thread of the showing.
    """

    def __init__(self, show: Callable[[Event], object], tell: Callable[[str], object]) -> None:
        self._show, self._tell = show, tell
        self._picture: Event | None = None
        self._end: Event | None = None
        self._over = False
        self._news = Condition()
        self._thread = Thread(target=self._run, name="tak pictures", daemon=True)

    def take(self, event: Event) -> None:
        """Take one event of the session; returns at once."""
        match event.data:
            case TelemetryReceived():
                with self._news:
                    self._picture = event
                    self._news.notify()
            case SessionEnded():
                with self._news:
                    self._end = event
                    self._news.notify()
            case _:
                pass

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        with self._news:
            self._over = True
            self._news.notify()
        self._thread.join(ENDS_S)

    def _run(self) -> None:
        try:
            while waiting := self._next():
                for event in waiting:
                    self._show(event)
        except Exception as error:  # whoever shows a session must not end it
            self._tell(f"nothing more is shown: {type(error).__name__}: {error}")

    def _next(self) -> list[Event]:
        """Wait for what is to be shown and return it; nothing at the end."""
        with self._news:
            self._news.wait_for(lambda: self._picture or self._end or self._over)
            waiting = [event for event in (self._picture, self._end) if event is not None]
            self._picture = self._end = None
        return waiting
