"""Logs of given events, what a log keeps of them, and the state that they come to."""

from collections.abc import Iterable
from pathlib import Path

from pa_console.schema.events.event import Event
from pa_console.session.log.writer import LogWriter
from pa_console.session.state import SessionState
from tests.session.story import story


def write_log(path: Path, happened: Iterable[Event], session: str = "S1") -> Path:
    """Write the log of `happened`, unsigned."""
    with LogWriter(path, session) as log:
        for event in happened:
            log.append(event)
    return path


def kept(happened: Iterable[Event] | None = None) -> list[Event]:
    """The events that a log keeps, of the story unless others are given."""
    told = story() if happened is None else happened
    return [event for event in told if not event.data.transient]


def folded(happened: Iterable[Event]) -> SessionState:
    """The session as it stands after `happened`."""
    state = SessionState()
    for event in happened:
        state.apply(event)
    return state
