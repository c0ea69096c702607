"""The panes that each kind of event changes, so that only those are repainted."""

from typing import Any

from textual.content import Content
from textual.screen import Screen
from textual.widget import Widget

FRAME_S = 0.12
"""The minimum wall time between two repaints, in seconds: at most about eight repaints a second."""

ALL_VIEWS: frozenset[str] = frozenset(("status", "map", "assets", "alarms", "trace", "events"))

_PICTURE = frozenset(("status", "map", "assets"))
_TRACE = frozenset(("trace",))
_ALARMS = frozenset(("status", "alarms", "events"))
_CONTACTS = frozenset(("status", "map", "events"))
_COMMAND = frozenset(("status", "trace"))
_BY_KIND = {
    "telemetry": _PICTURE | frozenset(("alarms",)),
    "incident": frozenset(("events",)),
    "noticed": frozenset(("events",)),
    "worker": frozenset(("status", "events")),
    "tak": frozenset(("status", "events")),
    "contact_reported": _CONTACTS,
    "contact_lost": _CONTACTS,
    "contacts_left_out": frozenset(("events",)),
    "log_troubled": frozenset(("status", "events")),
    "alarm_raised": _ALARMS,
    "alarm_acknowledged": _ALARMS,
    "alarm_cleared": _ALARMS,
    "queue_changed": _ALARMS,
    "text_streamed": _TRACE,
    "camera_still": frozenset(("trace", "events")),
    "command_sent": _COMMAND,
    "command_resent": _COMMAND,
    "command_replied": frozenset(("status", "trace", "events")),
}
_MISSION = frozenset(("status", "alarms", "trace", "events"))


def views_of(kind: str) -> frozenset[str]:
    """Return the panes that an event of this kind changes."""
    return _BY_KIND.get(kind, _MISSION)


def is_open(screen: Screen[Any]) -> bool:
    """Return whether `screen` is still in use: not left, and its application not closing.

    A timer may fire while a screen is being closed, when some of its widgets are already gone.
    """
    return screen.app.is_running and screen in screen.app.screen_stack


def retitle(pane: Widget, title: str) -> None:
    """Set the title of `pane` without markup; setting the same title again paints nothing."""
    content = Content(title)
    if pane.border_title != content.markup:
        pane.border_title = content
