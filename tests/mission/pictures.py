"""Small pictures of the checkpoint for tests that need no simulation."""

from typing import Any

from pa_console.schema.telemetry import AssetTelemetry, GateCover, Picture, Track
from pa_console.schema.world import AssetKind

GATES = ("NorthGate", "EastGate", "SouthGate", "WestGate")


def asset(name: str, kind: AssetKind, at: str | None, **changes: Any) -> AssetTelemetry:
    """Return an asset that stands at its post and is fine, but for `changes`."""
    values: dict[str, Any] = {
        "id": name, "kind": kind, "at": at, "post": at, "position": (0.0, 0.0),
        "heading_deg": 0.0, "speed_mps": 0.0, "status": "ok", "task": "idle",
        "battery_pct": 90.0, "low_battery": False, "comms": "ok", "available": True,
        "stamp_s": 10.0,
    }  # fmt: skip
    return AssetTelemetry(**(values | changes))


def track(name: str, gate: str, **changes: Any) -> Track:
    """Return an unknown vehicle near `gate`, but for `changes`."""
    values: dict[str, Any] = {
        "id": name, "kind": "vehicle", "gate": gate, "position": (0.0, 0.0), "heading_deg": 0.0,
        "speed_mps": 5.0, "distance_m": 40.0, "stamp_s": 10.0,
    }  # fmt: skip
    return Track(**(values | changes))


def picture(*assets: AssetTelemetry, tracks: tuple[Track, ...] = ()) -> Picture:
    """Return the picture of `assets`; a gate is covered by the available ones that stand there."""
    gates: dict[str, GateCover] = {}
    for gate in GATES:
        by = tuple(a.id for a in assets if a.available and a.at == a.post == gate)
        gates[gate] = GateCover(covered=bool(by), by=by)
    return Picture(
        tick=100,
        time_s=10.0,
        assets={a.id: a for a in assets},
        tracks={t.id: t for t in tracks},
        gates=gates,
    )
