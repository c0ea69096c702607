"""Turns changes between two pictures into lines for the operator's event list."""

from collections.abc import Iterator

from pa_console.schema.event import Noticed
from pa_console.schema.telemetry import AssetTelemetry, Picture, Track


def notices(was: Picture, now: Picture) -> Iterator[Noticed]:
    """Yield what an operator would want to be told between `was` and `now`."""
    for gate, cover in now.gates.items():
        if cover.covered != was.gates[gate].covered:
            text = f"covered by {', '.join(cover.by)}" if cover.covered else "no longer covered"
            yield Noticed(level="info" if cover.covered else "alarm", subject=gate, text=text)
    for name, asset in now.assets.items():
        yield from _asset(was.assets.get(name), asset)
    for name, track in now.tracks.items():
        yield from _track(was.tracks.get(name), track)
    for name in was.tracks.keys() - now.tracks.keys():
        yield Noticed(level="info", subject=name, text="track is gone")


def _asset(was: AssetTelemetry | None, now: AssetTelemetry) -> Iterator[Noticed]:
    if was is None:
        return
    if now.status != was.status:
        level = "alarm" if now.status == "failed" else "info"
        yield Noticed(level=level, subject=now.id, text=f"status {now.status}")
    if now.low_battery and not was.low_battery:
        text = f"battery low, {now.battery_pct:.0f} %"
        yield Noticed(level="warning", subject=now.id, text=text)
    if now.comms != was.comms:
        level = "info" if now.comms == "ok" else "warning"
        yield Noticed(level=level, subject=now.id, text=f"communications {now.comms}")


def _track(was: Track | None, now: Track) -> Iterator[Noticed]:
    if was is None:
        text = f"{now.identity} {now.kind} {now.status}, {now.gate}, {now.distance_m:.0f} m"
        yield Noticed(level="alarm", subject=now.id, text=text)
        return
    if now.observed and not was.observed:
        yield Noticed(level="info", subject=now.id, text="observed by a UAV")
    if now.identity != was.identity:
        yield Noticed(level="warning", subject=now.id, text=f"identified as {now.identity}")
    if now.intent != was.intent:
        level = "alarm" if now.intent == "hostile" else "info"
        yield Noticed(level=level, subject=now.id, text=f"intent {now.intent}")
    if now.warned and not was.warned:
        yield Noticed(level="info", subject=now.id, text="warned")
    if now.status != was.status:
        yield Noticed(level="info", subject=now.id, text=f"{now.status} at {now.gate}")
