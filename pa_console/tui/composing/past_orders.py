"""Orders that were given before, in this and in earlier sessions, the newest first."""

from collections.abc import Iterable, Iterator
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

from pa_console.session.log.chain import LogError
from pa_console.session.past_sessions import newest_logs, summarise

MOST_SESSIONS = 50
"""The number of sessions that are read, the newest first."""


class PastOrder(NamedTuple):
    """An order with when its session began and how it ended; both unknown outside every log."""

    text: str
    session_began: datetime | None = None
    ended: str = ""

    @property
    def note(self) -> str:
        """The note beside the words, in local time."""
        if self.session_began is None:
            return ""
        return f"{self.session_began.astimezone():%d %b %H:%M}  {self.ended or 'open'}"


def logged_orders(folder: Path) -> Iterator[list[PastOrder]]:
    """Yield the orders of one recorded session after the other; logs that are damaged are left out.

    Missions that alarms made are no orders.
    """
    for log in newest_logs(folder)[:MOST_SESSIONS]:
        try:
            found = summarise(log)
        except (LogError, OSError):
            continue
        own = (mission for mission in reversed(found.missions) if not mission.by_alarm)
        yield [PastOrder(each.said, found.started, each.status or "") for each in own]


def merged(typed: Iterable[str], logged: Iterable[PastOrder]) -> list[PastOrder]:
    """Return each order once: those that were `typed` at this terminal, then those of logs.

    Both come newest first. What was typed has the note of its newest log.
    """
    notes: dict[str, PastOrder] = {}
    for order in logged:
        notes.setdefault(order.text, order)
    orders = {text: notes.get(text, PastOrder(text)) for text in typed}
    return list({**orders, **notes}.values())
