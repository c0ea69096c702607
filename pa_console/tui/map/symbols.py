"""The signs of assets, tracks and cameras: a glyph for the cell where it is, and its name."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from pa_console.schema.telemetry import AssetTelemetry, CameraReport, Track
from pa_console.tui.report_condition import Reliance
from pa_console.tui.status_words import term

_ARROWS = "→↗↑↖←↙↓↘"
_TRACK_GLYPHS = {"vehicle": "■", "person": "▪"}
WIDE_UNCERTAINTY_M = 5.0
"""The uncertainty from which it is written beside a track, metres."""

TROUBLE = frozenset(("down", "stale", "suspect"))
"""The roles of assets that cannot be counted on."""

MOST_DIGIT = 9
"""A cell with more assets shows a plus, and the number beside it where there is room."""


class Symbol(NamedTuple):
    """The symbol of one thing: `glyph` at its place, `name` and `note` beside it.

    `warning` and `detail` follow the name of an asset whose report is fresh, the detail only if
    there is room.
    """

    glyph: str
    name: str
    role: str
    note: str = ""
    warning: str = ""
    detail: str = ""


def arrow(heading_deg: float) -> str:
    """Return the arrow nearest to a heading (0 east, 90 north)."""
    return _ARROWS[round(heading_deg / 45.0) % 8]


def asset_symbol(
    asset: AssetTelemetry, short: Mapping[str, str], look: Reliance, *, health: bool = True
) -> Symbol:
    """Return e.g. `→ D1`, or `? D1 7s` when the last report is 7 s old and proves nothing more.

    A low battery and a weak link follow the name, e.g. `→ D1 19%▼◐`, unless `health` is false.
    """
    name = short.get(asset.id, asset.id[:2])
    state = look.report(asset)
    if asset.status == "failed" or (state == "fresh" and not asset.available):
        return Symbol(term("asset", "failed").glyph, name, "down")
    if state == "suspect":
        return Symbol(term("report", state).glyph, name, "suspect")
    if state != "fresh":
        return Symbol("?", name, "stale", f"{look.age(asset):.0f}s")
    if not health:
        return Symbol(arrow(asset.heading_deg), name, asset.kind)
    weak = term("comms", asset.comms).glyph if asset.comms != "ok" else ""
    charge = f"{asset.battery_pct:.0f}%"
    warning, detail = (f"{charge}▼{weak}", "") if asset.low_battery else (weak, charge)
    return Symbol(arrow(asset.heading_deg), name, asset.kind, "", warning, detail)


def track_symbol(track: Track, number: str, look: Reliance) -> Symbol:
    """Return e.g. `■ ?1` (an unknown vehicle) or `■ ‼2` (a hostile one); if unseen, with an age."""
    hostile = track.intent == "hostile"
    sign = term("intent", "hostile") if hostile else term("identity", track.identity)
    glyph, name = _TRACK_GLYPHS[track.kind], f"{sign.glyph}{number}"
    if look.lost(track):
        return Symbol(glyph, name, "track-stale", f"{look.age(track):.0f}s?")
    vague = f"±{track.uncertainty_m:.0f}" if track.uncertainty_m >= WIDE_UNCERTAINTY_M else ""
    return Symbol(glyph, name, "track-hostile" if hostile else f"track-{track.identity}", vague)


def camera_symbol(camera: CameraReport, look: Reliance) -> Symbol:
    """Return the sign of a gate camera; one that works needs no name."""
    state = look.camera(camera)
    glyph = term("camera", state).glyph
    return (
        Symbol(glyph, "", "camera") if state == "works" else Symbol("▿", glyph, f"camera-{state}")
    )


def count_glyph(count: int) -> str:
    """Return the one glyph for that many things in a cell."""
    return str(count) if count <= MOST_DIGIT else "+"


def crowd_symbol(roles: Sequence[str]) -> Symbol:
    """Return e.g. `5`, `5 ✘2` when two of the five cannot be counted on, or `+ 12`.

    `roles` are those of the assets' own symbols.
    """
    down = [role for role in roles if role in TROUBLE]
    glyph = count_glyph(len(roles))
    number = str(len(roles)) if len(roles) > MOST_DIGIT else ""
    if not down:
        return Symbol(glyph, number, "dimmed" if {*roles} == {"dimmed"} else "crowd")
    failed = "down" in down
    sign = term("asset", "failed").glyph if failed else "?"
    return Symbol(glyph, f"{number}{sign}{len(down)}", "crowd-down" if failed else "crowd-stale")


def edge_arrow(right: int, down: int) -> str:
    """Return the arrow towards a thing that many cells beyond the edge, in at least one way."""
    if down:
        return ("↖↑↗" if down < 0 else "↙↓↘")[1 + (right > 0) - (right < 0)]
    return "→" if right > 0 else "←"
