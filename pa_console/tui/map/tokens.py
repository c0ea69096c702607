"""What stands for an asset, a track, a camera or a crowd on the map: text and role."""

from collections.abc import Mapping, Sequence

from pa_console.schema.telemetry import AssetTelemetry, CameraReport, Track
from pa_console.tui.condition import Reliance
from pa_console.tui.vocabulary import term

_ARROWS = "→↗↑↖←↙↓↘"
_TRACK_GLYPHS = {"vehicle": "■", "person": "▪"}
WIDE_UNCERTAINTY_M = 5.0
"""From here on the position's uncertainty is written beside a track, in metres."""

Token = tuple[str, str]
"""(text, role)"""


def arrow(heading_deg: float) -> str:
    """Return the arrow nearest to a heading (0 east, 90 north)."""
    return _ARROWS[round(heading_deg / 45.0) % 8]


def asset_token(asset: AssetTelemetry, short: Mapping[str, str], look: Reliance) -> Token:
    """Return e.g. `D1→`, or `D1?7s` when the last report is 7 s old and proves nothing any more."""
    name = short.get(asset.id, asset.id[:2])
    state = look.report(asset)
    if asset.status == "failed" or (state == "fresh" and not asset.available):
        return f"{name}{term('asset', 'failed').glyph}", "down"
    if state == "suspect":
        return f"{name}{term('report', state).glyph}", "suspect"
    if state != "fresh":
        return f"{name}?{look.age(asset):.0f}s", "stale"
    return f"{name}{arrow(asset.heading_deg)}", asset.kind


def track_token(track: Track, number: str, look: Reliance) -> Token:
    """Return e.g. `■?1` (an unknown vehicle) or `■‼2` (a hostile one); unseen ones have an age."""
    hostile = track.intent == "hostile"
    sign = term("intent", "hostile") if hostile else term("identity", track.identity)
    text = f"{_TRACK_GLYPHS[track.kind]}{sign.glyph}{number}"
    if look.lost(track):
        return f"{text}?{look.age(track):.0f}s", "track-stale"
    if track.uncertainty_m >= WIDE_UNCERTAINTY_M:
        text += f"±{track.uncertainty_m:.0f}"
    return text, "track-hostile" if hostile else f"track-{track.identity}"


def camera_token(camera: CameraReport, look: Reliance) -> Token:
    """Return the sign of a gate camera."""
    state = look.camera(camera)
    glyph = term("camera", state).glyph
    return (glyph, "camera") if state == "works" else (f"▿{glyph}", f"camera-{state}")


def crowd_token(assets: Sequence[AssetTelemetry], look: Reliance) -> Token:
    """Return e.g. `×12`, or `×12✘2` when two of the twelve cannot be counted on."""
    down = [a for a in assets if not a.available or look.report(a) != "fresh"]
    if not down:
        return f"×{len(assets)}", "crowd"
    doubtful = all(a.status != "failed" and look.report(a) != "fresh" for a in down)
    sign = "?" if doubtful else term("asset", "failed").glyph
    return f"×{len(assets)}{sign}{len(down)}", "stale" if doubtful else "crowd-down"
