"""PA Console: command a team of robots in plain language, safely, on an edge computer.

`import pa_console as pa` provides the names in `__all__`. The module that defines a name is
imported when the name is first used. The manual's page python-api.md has examples.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pa_console.api.logs import read_log, verify_log
    from pa_console.api.sites import check_plan, load_rules, load_site, load_world
    from pa_console.api.station import (
        Outcome,
        Served,
        Station,
        auto_approver,
        leave_to_clients,
        open_station,
    )
    from pa_console.fleets.fleet import Fleet, Forecast, Received
    from pa_console.fleets.simulated import SimulatedFleet
    from pa_console.policy.rulebook import Rulebook
    from pa_console.schema.command import CommandReply, DeviceCommand
    from pa_console.schema.events.event import (
        AnswerLine,
        ApprovalRequested,
        Event,
        QuestionAnswered,
    )
    from pa_console.schema.finding import Finding
    from pa_console.schema.mission import Decision, Mission
    from pa_console.schema.plan import Plan
    from pa_console.schema.telemetry import AssetTelemetry, GateCover, Picture, Track
    from pa_console.schema.world import World
    from pa_console.session.state import SessionState
    from pa_console.station.assembly import Site

    __version__: str

__all__ = [
    "AnswerLine",
    "ApprovalRequested",
    "AssetTelemetry",
    "CommandReply",
    "Decision",
    "DeviceCommand",
    "Event",
    "Finding",
    "Fleet",
    "Forecast",
    "GateCover",
    "Mission",
    "Outcome",
    "Picture",
    "Plan",
    "QuestionAnswered",
    "Received",
    "Rulebook",
    "Served",
    "SessionState",
    "SimulatedFleet",
    "Site",
    "Station",
    "Track",
    "World",
    "auto_approver",
    "check_plan",
    "leave_to_clients",
    "load_rules",
    "load_site",
    "load_world",
    "open_station",
    "read_log",
    "verify_log",
]

_HOMES = {
    "api.logs": ("read_log", "verify_log"),
    "api.sites": ("check_plan", "load_rules", "load_site", "load_world"),
    "api.station": (
        "Outcome", "Served", "Station", "auto_approver", "leave_to_clients", "open_station",
    ),
    "fleets.fleet": ("Fleet", "Forecast", "Received"),
    "fleets.simulated": ("SimulatedFleet",),
    "station.assembly": ("Site",),
    "policy.rulebook": ("Rulebook",),
    "schema.command": ("CommandReply", "DeviceCommand"),
    "schema.events.event": ("AnswerLine", "ApprovalRequested", "Event", "QuestionAnswered"),
    "schema.finding": ("Finding",),
    "schema.mission": ("Decision", "Mission"),
    "schema.plan": ("Plan",),
    "schema.telemetry": ("AssetTelemetry", "GateCover", "Picture", "Track"),
    "schema.world": ("World",),
    "session.state": ("SessionState",),
}  # fmt: skip
"""The public names, grouped by the module from which they are imported."""


def __getattr__(name: str) -> Any:
    """Import a public name on its first use."""
    for home, names in _HOMES.items():
        if name in names:
            value = getattr(import_module(f"pa_console.{home}"), name)
            break
    else:
        if name != "__version__":
            raise AttributeError(f"module 'pa_console' has no attribute {name!r}")
        value = _version()
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List the public names, imported or not."""
    return sorted({*globals(), *__all__, "__version__"})


def _version() -> str:
    """Return the installed version; 0.0.0 if the package is on the path but not installed."""
    from importlib.metadata import PackageNotFoundError, version  # noqa: PLC0415 - slow to import

    try:
        return version("pa-console")
    except PackageNotFoundError:
        return "0.0.0"
