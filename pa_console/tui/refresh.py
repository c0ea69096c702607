"""Which panes an event concerns, so that the others are left alone."""

ALL_VIEWS = frozenset(("status", "map", "assets", "trace", "events"))

_PICTURE = frozenset(("status", "map", "assets"))
_TRACE = frozenset(("trace",))
_BY_KIND = {
    "telemetry": _PICTURE,
    "incident": frozenset(("events",)),
    "noticed": frozenset(("events",)),
    "worker": frozenset(("status", "events")),
    "text_streamed": _TRACE,
    "command_sent": frozenset(("status", "trace")),
    "command_replied": frozenset(("trace", "events")),
}
_MISSION = frozenset(("status", "trace", "events"))


def views_of(kind: str) -> frozenset[str]:
    """Return the panes that show something of an event of this kind."""
    return _BY_KIND.get(kind, _MISSION)
