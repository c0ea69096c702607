"""All assets and tracks, a row each; a row is painted again only when its text changed."""

from textual import events
from textual.containers import VerticalScroll
from textual.content import Content
from textual.widgets import Static

from pa_console.schema.telemetry import AssetTelemetry, Picture, Track
from pa_console.schema.world import World
from pa_console.tui.map.scene import arrow, track_token
from pa_console.tui.trace.rows import column
from pa_console.tui.vocabulary import BAD, QUIET, WARN, term
from pa_console.tui.words import short_names

STALE_AFTER_S = 3.0
"""Simulated seconds after which a report is called stale."""

HEADINGS = (
    ("", 3),
    ("asset", 10),
    ("status", 10),
    ("task", 11),
    ("at / to", 11),
    ("batt", 5),
    ("link", 6),
    ("age", 4),
)


class AssetTable(VerticalScroll):
    """Status, task, place, battery, link and age of the last report of every asset."""

    def __init__(self, world: World, **kwargs: str) -> None:
        super().__init__(id=kwargs.get("id"))
        self._short = short_names(world.assets)
        self._picture: Picture | None = None
        self._shown: dict[str, Content] = {}
        self.border_title = "Assets and tracks"

    def show(self, picture: Picture | None) -> None:
        """Show another picture, changing only the rows that differ."""
        self._picture = picture
        if not self.is_mounted:
            return
        width = self.scrollable_content_region.width or self.content_size.width
        lines = self._lines(picture, width)
        for key in [key for key in self._shown if key not in lines]:
            self.query_one(f"#row-{key}", Static).remove()
            del self._shown[key]
        for key, line in lines.items():
            if key not in self._shown:
                self.mount(Static(line, id=f"row-{key}", markup=False))
            elif not line.is_same(self._shown[key]):
                self.query_one(f"#row-{key}", Static).update(line)
            self._shown[key] = line

    def on_resize(self, _event: events.Resize) -> None:
        """Lay the columns out for the new width."""
        self.show(self._picture)

    def _lines(self, picture: Picture | None, width: int) -> dict[str, Content]:
        heading = [column(word, cells, QUIET) for word, cells in _fitting(width)]
        lines = {"heading": Content.assemble(*heading).truncate(width)}
        if picture is None:
            return lines | {"none": Content.styled("no telemetry yet: unknown", WARN)}
        for asset in picture.assets.values():
            lines[asset.id] = _line(asset_cells(asset, self._short, picture.time_s), width)
        for number, track in enumerate(picture.tracks.values(), start=1):
            lines[track.id] = _line(track_cells(track, number, picture.time_s), width)
        return lines


def _fitting(width: int) -> list[tuple[str, int]]:
    """Return the columns that fit: the long name goes first when room is short."""
    columns = list(HEADINGS)
    if sum(cells + 1 for _, cells in columns) - 1 > width:
        columns = [item for item in columns if item[0] != "asset"]
    return columns


def _line(cells: dict[str, tuple[str, str]], width: int) -> Content:
    fields = [column(cells[name][0], room, cells[name][1]) for name, room in _fitting(width)]
    return Content.assemble(*fields).truncate(width)


def asset_cells(
    asset: AssetTelemetry, short: dict[str, str], now_s: float
) -> dict[str, tuple[str, str]]:
    """Return (text, style) for each column of an asset's row."""
    status, comms = term("asset", asset.status), term("comms", asset.comms)
    age = now_s - asset.stamp_s
    going = asset.at or (f"{arrow(asset.heading_deg)} {asset.post}" if asset.post else "between")
    low = "▼" if asset.low_battery else ""
    return {
        "": (short[asset.id], "bold"),
        "asset": (asset.id, ""),
        "status": (f"{status.glyph} {status.word}", status.style),
        "task": (asset.task, QUIET if asset.task in ("idle", "holding") else ""),
        "at / to": (going, "" if asset.at else "$text-accent"),
        "batt": (f"{asset.battery_pct:3.0f}%{low}", WARN if low else ""),
        "link": (f"{comms.glyph} {comms.word}", comms.style),
        "age": age_cell(age),
    }


def track_cells(track: Track, number: int, now_s: float) -> dict[str, tuple[str, str]]:
    """Return (text, style) for each column of a track's row."""
    identity = term("identity", track.identity)
    names = list(short_names(track.observed_by).values())
    seen = names[0] if len(names) == 1 else str(len(names) or "")
    return {
        "": (track_token(track, number)[0], f"bold {identity.style}"),
        "asset": (track.kind, ""),
        "status": (identity.word.lower(), identity.style),
        "task": ("warned" if track.warned else track.status, WARN),
        "at / to": (track.gate, ""),
        "batt": (f"{track.distance_m:3.0f}m", ""),
        "link": (f"by {seen}" if seen else "unseen", QUIET if seen else WARN),
        "age": age_cell(now_s - track.stamp_s),
    }


def age_cell(age_s: float) -> tuple[str, str]:
    """Return the age of a report; one that is old carries a mark, never looks fine."""
    if age_s < STALE_AFTER_S:
        return f"{max(age_s, 0.0):3.1f}", QUIET
    return f"{min(age_s, 999):.0f}!", BAD
