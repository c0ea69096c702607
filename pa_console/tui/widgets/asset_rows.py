"""How an asset, a track and a camera look as a row of the table, and what a filter finds in it."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from textual.content import Content

from pa_console.schema.telemetry import AssetTelemetry, CameraReport, Identity, Track
from pa_console.tui.condition import FINE, Reliance, track_rank
from pa_console.tui.map.tokens import arrow
from pa_console.tui.trace.rows import column
from pa_console.tui.vocabulary import BAD, QUIET, WARN, term
from pa_console.tui.words import KIND_WORDS, few, short_names

Cells = Mapping[str, tuple[str, str]]
"""Text and style by column."""

NOTES = "notes"
"""The column that takes the room that is left."""


class Layout(NamedTuple):
    """Columns of one group of rows with their widths, and which go first when room is short."""

    title: str
    columns: tuple[tuple[str, int], ...]
    dropped_first: tuple[str, ...]

    def fitting(self, width: int) -> tuple[tuple[str, int], ...]:
        """Return the columns that fit into `width` cells."""
        columns = list(self.columns)
        for name in self.dropped_first:
            if sum(cells + 1 for _, cells in columns) - 1 <= width:
                break
            columns = [item for item in columns if item[0] != name]
        return tuple(columns)

    def heading(self, width: int, note: str = "") -> Content:
        """Return the names of the columns; the first has the group's title."""
        words = [column(name, cells, QUIET) for name, cells in self.fitting(width)[1:]]
        first = column(self.title, self.columns[0][1], f"bold {QUIET}")
        return Content.assemble(first, *words, (note, QUIET)).truncate(width)

    def line(self, cells: Cells, width: int) -> Content:
        """Return a row; `notes` get the room that is left."""
        fields = [column(cells[n][0], room, cells[n][1]) for n, room in self.fitting(width)]
        return Content.assemble(*fields, cells.get(NOTES, "")).truncate(width, ellipsis=True)


ASSETS = Layout(
    "",
    (("", 5), ("asset", 10), ("status", 12), ("task", 11), ("at / to", 11), ("batt", 5),
     ("link", 6), ("age", 5)),
    ("asset", "link", "batt"),
)  # fmt: skip
_TRACKS = Layout(
    "track",
    (("track", 11), ("gate", 10), ("dist", 5), ("ident.", 9), ("intent", 9), ("age", 5)),
    ("gate",),
)
_WIDE_TRACKS = Layout(
    "track",
    (("track", 12), ("gate", 11), ("dist", 5), ("identity", 14), ("intent", 9), ("age", 5)),
    (),
)
_WIDE = 74
_BRIEFLY: dict[Identity, str] = {
    "unknown": "unknown", "authorized": "author.", "unauthorized": "UNAUTH.",
}  # fmt: skip
CAMERAS = Layout("camera", (("camera", 16), ("gate", 11), ("status", 10), ("age", 5)), ())


def tracks(width: int) -> Layout:
    """Return the columns of tracks for `width` cells."""
    return _WIDE_TRACKS if width >= _WIDE else _TRACKS


def asset_cells(asset: AssetTelemetry, short: Mapping[str, str], look: Reliance) -> Cells:
    """Return the cells of an asset; what an unreliable report says is dimmed and questioned."""
    status, comms, state = look.asset(asset), term("comms", asset.comms), look.report(asset)
    going = asset.at or (f"{arrow(asset.heading_deg)} {asset.post}" if asset.post else "between")
    low = "▼" if asset.low_battery else ""
    doubt = "" if state == "fresh" else "?"
    calm = asset.task in ("idle", "holding")
    return {
        "": (short.get(asset.id, asset.id), "bold"),
        "asset": (asset.id, ""),
        "status": (f"{status.glyph} {status.word}", status.style),
        "task": (f"{asset.task}{doubt}", QUIET if calm or doubt else ""),
        "at / to": (_questioned(going, doubt), QUIET if doubt else "" if asset.at else WARN),
        "batt": (f"{asset.battery_pct:3.0f}%{low or doubt}", WARN if low else QUIET * bool(doubt)),
        "link": (f"{comms.glyph} {comms.word}", comms.style),
        "age": age_cell(look.age(asset), old=state in ("stale", "silent")),
    }


def track_cells(track: Track, look: Reliance) -> Cells:
    """Return the cells of a track; one that is not seen any more says so before all else."""
    identity, intent = term("identity", track.identity), term("intent", track.intent)
    lost = look.lost(track)
    style = QUIET if lost else identity.style
    sign = "■" if track.kind == "vehicle" else "▪"
    return {
        "track": (f"{sign} {track.id}", f"bold {style}"),
        "gate": (track.gate, QUIET if lost else ""),
        "dist": (f"{track.distance_m:.0f} m{'?' if lost else ''}", QUIET if lost else ""),
        "identity": (f"{identity.glyph} {identity.word}", style),
        "ident.": (f"{identity.glyph} {_BRIEFLY[track.identity]}", style),
        "intent": (f"{intent.glyph} {intent.word}", intent.style),
        "age": age_cell(look.age(track), old=lost),
        NOTES: _track_notes(track, look),
    }


def _track_notes(track: Track, look: Reliance) -> tuple[str, str]:
    """Return who says that it is hostile, what it does, and how sure its position is."""
    urgent = track.intent == "hostile" or track.defiant
    parts: list[str] = []
    if look.lost(track):
        parts.append("not seen now")
    if track.hostile_by:
        parts.append(f"by {few(_short(track.hostile_by))}")
    if track.defiant:
        parts.append("DEFIES warning")
    elif track.warned:
        parts.append("warned")
    parts.append(track.status)
    if track.noncombatants:
        parts.append("noncombatants?")
    if track.uncertainty_m >= 0.5:
        parts.append(f"±{track.uncertainty_m:.0f} m")
    seen = track.seen_by or track.observed_by
    if seen and not track.hostile_by:
        parts.append(f"seen by {few(_short(seen), 2)}")
    return ", ".join(parts), BAD if urgent else QUIET


def _short(names: Sequence[str]) -> list[str]:
    return list(short_names(names).values())


def camera_cells(name: str, camera: CameraReport, look: Reliance) -> Cells:
    """Return the cells of a gate camera."""
    state = look.camera(camera)
    mark = term("camera", state)
    return {
        "camera": (name, "bold"),
        "gate": (camera.gate, ""),
        "status": (f"{mark.glyph} {mark.word}", mark.style),
        "age": age_cell(look.age(camera), old=state == "unknown"),
    }


def _questioned(text: str, doubt: str, room: int = 11) -> str:
    return text[: room - len(doubt)] + doubt


def age_cell(age_s: float, *, old: bool) -> tuple[str, str]:
    """Return the age of a report; one that is old carries a mark, never looks fine."""
    if not old:
        return f"{min(age_s, 99):.1f} s", QUIET
    return f"{min(age_s, 999):.0f} s!", BAD


def asset_words(asset: AssetTelemetry, short: Mapping[str, str], look: Reliance) -> str:
    """Return the text in which a filter looks for its words."""
    problem = "problem" if look.rank(asset) < FINE else "fine"
    low = "low battery" if asset.low_battery else ""
    return " ".join(
        (asset.id, short.get(asset.id, ""), asset.kind, KIND_WORDS[asset.kind], "asset",
         asset.at or "", asset.post or "", asset.task, look.asset(asset).word,
         look.report(asset), asset.comms, low, problem)
    ).lower()  # fmt: skip


def track_words(track: Track, look: Reliance) -> str:
    """Return the text in which a filter looks for its words."""
    problem = "problem" if track_rank(track)[0] < 4 else "fine"
    seen = "stale" if look.lost(track) else ""
    warned = "warned" if track.warned else ""
    return " ".join(
        (track.id, "track", track.kind, track.gate, track.identity, track.intent, track.status,
         seen, warned, problem)
    ).lower()  # fmt: skip


def camera_words(name: str, camera: CameraReport, look: Reliance) -> str:
    """Return the text in which a filter looks for its words."""
    state = look.camera(camera)
    return (
        f"{name} camera {camera.gate} {state} {'fine' if state == 'works' else 'problem'}".lower()
    )
